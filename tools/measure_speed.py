"""Measures the stages of a prediction and how their cost grows, and writes benchmarks/SPEED.md.

    python tools/measure_speed.py [-o benchmarks/SPEED.md] [--quick]

The object is a ball of many triangles with blotchy material under a smooth light, so no data are needed. Times are
medians; what the machine can do at most, copying memory and multiplying, is measured in the same run. How long a whole
training takes and how much memory it needs stands in RESULTS.md, from the logs of real runs.
"""

import argparse
import math
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
import trimesh
from torch import Tensor

from lightprobe.cli.bench import commit, machine
from lightprobe.core.files import write_bytes
from lightprobe.decompose import Decomposition
from lightprobe.geometry.atlas import triangle_atlas
from lightprobe.geometry.mesh import Mesh
from lightprobe.light import cubemap, prefilter
from lightprobe.material.textures import Textures
from lightprobe.predict import Method, Predictor
from lightprobe.predict.confidence import confidence
from lightprobe.predict.observation import observe
from lightprobe.predict.prior import constant_light
from lightprobe.predict.solve import solve_environment
from lightprobe.render.asset import Asset, rasterize_asset, render_asset
from lightprobe.render.openness import openness_table
from lightprobe.render.transport import Transport
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.photo import Pixels

CPU = torch.device("cpu")
SIDE, TEXELS, SUBDIVISIONS = 320, 32, 5  # the usual photo, light and ball (20 480 triangles)
Stages = dict[str, float]  # seconds


def ball(subdivisions: int) -> Asset:
    """Return a unit ball of 20 * 4^n triangles that knows its own shadows."""
    shape = trimesh.creation.icosphere(subdivisions)
    vertices = torch.from_numpy(np.asarray(shape.vertices)).float()
    faces = torch.from_numpy(np.asarray(shape.faces).astype(np.int32))
    uvs, uv_faces = triangle_atlas(len(faces), 1024)
    blotches = torch.rand(1, 5, 8, 8, generator=torch.Generator().manual_seed(5))
    maps = torch.nn.functional.interpolate(blotches, (1024, 1024), mode="bilinear")[0].permute(1, 2, 0).contiguous()
    up = torch.tensor([0.0, 0.0, 1.0]).expand(1024, 1024, 3).contiguous()
    textures = Textures(0.1 + 0.8 * maps[..., :3], 0.2 + 0.5 * maps[..., 3], (maps[..., 4] > 0.6).float(), up)
    mesh = Mesh(vertices, faces, torch.from_numpy(uvs).float(), torch.from_numpy(uv_faces.astype(np.int32)))
    return Asset(mesh, textures, openness_table(vertices, faces))


def camera(side: int) -> Camera:
    """Return a camera on the x axis in whose square picture the ball fills most of the frame."""
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    pose[0, 3] = 3.2
    return Camera(pose, 1.4 * side, 1.4 * side, side / 2, side / 2, side, side)


def light(resolution: int) -> Tensor:
    """Return a soft lamp in a dim room, (6, R, R, 3)."""
    towards = cubemap.directions(resolution) @ torch.tensor([0.6, 0.0, 0.8])
    return 0.3 + 3 * torch.exp(8 * (towards - 1))[..., None] * torch.tensor([1.0, 0.8, 0.6])


def photograph(asset: Asset, view: Camera) -> Pixels:
    """Return the ball's photo."""
    image, cover = render_asset(asset, view, light(TEXELS), prefilter.cached(TEXELS))
    color = image / cover[..., None].clamp(min=1e-6)
    return Pixels(color.clamp(max=1).numpy(), cover.numpy())


def seconds(work: Callable[[], object], repeats: int) -> float:
    """Return the median time of a call, after one that warms up."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


@torch.no_grad()
def stages(asset: Asset, side: int, texels: int, repeats: int) -> Stages:
    """Return the time of every stage of a prediction, and of the whole."""
    view = camera(side)
    photo = photograph(asset, view)
    operator, env = prefilter.cached(texels), light(texels)
    decomposition = Decomposition(asset, {}, Similarity(np.zeros(3), 1.0))
    predictor = Predictor(decomposition, light_resolution=texels)
    observation = observe(asset, photo, view, CPU, predictor.max_pixels)
    prior = constant_light(observation, texels)
    transport = Transport(observation.gbuffer, operator, observation.rows)
    radiance = transport.apply(env)
    works: dict[str, Callable[[], object]] = {
        "rasterise": lambda: rasterize_asset(asset, view, CPU),
        "render": lambda: render_asset(asset, view, env, operator),
        "prefilter": lambda: operator.apply(env),
        "build transport": lambda: Transport(observation.gbuffer, operator, observation.rows),
        "apply transport": lambda: transport.apply(env),
        "its adjoint": lambda: transport.adjoint(radiance),
        "solve": lambda: solve_environment(observation, prior, predictor.solve, 0),
        "confidence": lambda: confidence(observation, env, fitted=True, seed=0),
        "prediction (solve)": lambda: predictor.predict(photo, view, Method.SOLVE),
    }
    return {name: seconds(work, repeats) for name, work in works.items()}


def exponent(sizes: list[float], times: list[float]) -> float:
    """Return the power of the size with which the time grows, fitted to logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def growth(name: str, cases: dict[float, Stages]) -> list[str]:
    """Return the table of one kind of growth: milliseconds by size, and the exponent."""
    sizes = list(cases)
    rows = [f"| {name} | {' | '.join(f'{size:,.0f}' for size in sizes)} | exponent |"]
    rows.append("| --- |" + " ---: |" * (len(sizes) + 1))
    for stage in cases[sizes[0]]:
        times = [cases[size][stage] for size in sizes]
        cells = " | ".join(f"{1000 * value:.1f}" for value in times)
        rows.append(f"| {stage} | {cells} | {exponent(sizes, times):.2f} |")
    return rows


def limits() -> list[str]:
    """Return the rates of copying and of multiplying matrices, with all threads."""
    source, target = torch.rand(2**25), torch.empty(2**25)
    copy = 2 * source.numel() * 4 / seconds(lambda: target.copy_(source), 5)
    a = torch.rand(1536, 1536)
    multiply = 2 * 1536**3 / seconds(lambda: a @ a, 5)
    return [
        f"- copying memory: {copy / 1e9:.1f} GB/s",
        f"- multiplying and adding, float32: {multiply / 1e9:.0f} GFLOP/s",
    ]


def page(repeats: int, quick: bool) -> str:
    """Measure everything and return the page."""
    asset, covered = ball(SUBDIVISIONS), math.pi * (1.4 * 1 / math.sqrt(3.2**2 - 1)) ** 2
    sides = (128, 256) if quick else (128, 181, 256, 362, 512)
    lights = (16, 32) if quick else (16, 32, 64)
    levels = (3, 4) if quick else (3, 4, 5, 6)
    pixels = {covered * side**2: stages(asset, side, TEXELS, repeats) for side in sides}
    texels = {6.0 * r * r: stages(asset, SIDE, r, repeats) for r in lights}
    faces = {20.0 * 4**n: stages(ball(n), SIDE, TEXELS, repeats) for n in levels}
    lines = [
        "# Speed of the stages", "",
        "Written by `tools/measure_speed.py`. Milliseconds, medians; a ball of 20 480 triangles, a photo of 320 x 320",
        "and a light of 6 x 32 x 32 where not varied. A prediction reduces photos to 65 536 object pixels and solves",
        "from 12 288 of them, so its cost stops growing.", "",
        f"- commit: {commit()}", f"- machine: {machine()}", f"- threads: {torch.get_num_threads()}", *limits(), "",
        *growth("object pixels", pixels), "", *growth("texels of the light", texels), "", *growth("triangles", faces),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def main() -> None:
    """Read the command line, measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("benchmarks/SPEED.md"))
    parser.add_argument("--quick", action="store_true", help="fewer sizes, one repeat")
    given = parser.parse_args()
    write_bytes(given.output, page(1 if given.quick else 5, given.quick).encode())
    print(f"Speed: {given.output}")


if __name__ == "__main__":
    main()

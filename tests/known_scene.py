"""A known object and photos rendered from it, with all of their truth in files."""

import dataclasses

import numpy as np
import torch

from lightprobe.evaluation import relight
from lightprobe.geometry.textures import Textures
from lightprobe.imaging import write_exr, write_png
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.scene.camera import Similarity
from lightprobe.scene.photo import Photo, Scene, Truth
from tests.shapes import camera_at, sphere_mesh

CPU = torch.device("cpu")
SIMILARITY = Similarity(np.array([0.2, -0.1, 0.3]), 2.0)


def known_decomposition() -> Decomposition:
    size = 64
    ramp = torch.linspace(0, 1, size)
    down, across = torch.meshgrid(ramp, ramp, indexing="ij")
    color = torch.stack([0.2 + 0.5 * down, 0.6 - 0.3 * across, torch.full_like(down, 0.3)], -1)
    up = torch.tensor([0.0, 0.0, 1.0]).expand(size, size, 3)
    textures = Textures(color, 0.3 + 0.4 * down, 0.2 * across, up)
    return Decomposition(
        Asset(sphere_mesh(3), textures), {"light": Environment(torch.ones(6, 16, 16, 3))}, SIMILARITY
    )


def soft_sky(seed: int) -> np.ndarray:
    """A smooth equirectangular light (32, 64, 3) with a warm lamp somewhere."""
    y, x = np.mgrid[:32, :64]
    theta, phi = np.pi * (y + 0.5) / 32, np.pi - 2 * np.pi * (x + 0.5) / 64
    directions = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    lamp = np.random.default_rng(seed).normal(size=3)
    glow = np.exp(4 * (directions @ lamp / np.linalg.norm(lamp) - 1))[..., None]
    return (0.25 + 0.15 * directions[..., 2:] + glow * [1.6, 1.2, 0.8]).astype(np.float32)


def write_photo(folder, name: str, decomposition: Decomposition, position) -> Photo:
    """Render a photo with all of its truth into files."""
    camera = camera_at(2.0 * np.asarray(position), size=56, focal=70)
    camera = dataclasses.replace(camera, camera_to_world=camera.camera_to_world.copy())
    camera.camera_to_world[:3, 3] += SIMILARITY.center
    files = {key: folder / f"{name}_{key}.exr" for key in ("environment", "linear", "normal")}
    files |= {key: folder / f"{name}_{key}.png" for key in ("base_color", "orm")}
    write_exr(files["environment"], soft_sky(len(name)))
    image, cover = (
        t.numpy() for t in relight(decomposition, Environment.load(files["environment"], CPU), camera)
    )
    write_exr(files["linear"], np.concatenate([image, cover[..., None]], -1))
    write_png(folder / f"{name}.png", image / np.maximum(cover, 1e-6)[..., None], cover, bits=16)
    g = rasterize_asset(decomposition.asset, camera.normalised(SIMILARITY), CPU)
    maps = {key: np.zeros((56 * 56, 3), np.float32) for key in ("base_color", "orm", "normal")}
    maps["base_color"][g.pixel], maps["normal"][g.pixel] = g.base_color, g.normal
    maps["orm"][g.pixel, 1], maps["orm"][g.pixel, 2] = g.roughness, g.metallic
    write_png(files["base_color"], maps["base_color"].reshape(56, 56, 3), bits=16)
    write_png(files["orm"], maps["orm"].reshape(56, 56, 3), srgb=False, bits=16)
    write_exr(files["normal"], maps["normal"].reshape(56, 56, 3))
    return Photo(name, camera, folder / f"{name}.png", truth=Truth(**files))


def known_scene(folder) -> tuple[Decomposition, Scene]:
    """Return the decomposition, and a scene of its own renders in `folder`."""
    decomposition = known_decomposition()
    test = tuple(
        write_photo(folder, n, decomposition, p) for n, p in (("a", (3, 1, 1)), ("bb", (-1, 3, 0.5)))
    )
    relit = (write_photo(folder, "ccc", decomposition, (1, -3, 0)),)
    vertices = SIMILARITY.invert(decomposition.asset.mesh.vertices.numpy())
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in decomposition.asset.mesh.faces.tolist()]
    (folder / "mesh.obj").write_text("\n".join(lines))
    return decomposition, Scene(folder, "transforms", test[:1], test, relit, SIMILARITY)

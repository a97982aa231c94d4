"""How much brighter is a light than what a photo shows of it, and does that tell how bright the object is?

    python tools/measure_surroundings.py HDRIS DATA/synthetic/spot DATA/synthetic/bottle

What `reconstruction.surroundings` rests on, as two tables in Markdown. The first: photographed environments
(a folder of maps) under pinhole cameras of 56 degrees that look from all sides at a point, exposed so that a
matte grey object of .5 shows .25 on average. The second: true objects with base colours times a factor, the
lights of 20 training photos solved anew (preset quick), over what these photos would show of their true
environments around the object.
"""

import argparse
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import torch
from lightprobe.report.markdown import markdown_table
from torch import Tensor

from composed_photos import background
from lightprobe.core.config import DecomposeConfig, Preset, settings
from lightprobe.core.device import draw_rows, generator
from lightprobe.evaluation.oracle import true_asset
from lightprobe.imaging import read_hdr
from lightprobe.light.environment import Environment
from lightprobe.light.files import environment_files
from lightprobe.reconstruction.gauge import brightened
from lightprobe.reconstruction.lights import solve_target_light
from lightprobe.reconstruction.photos import load_targets
from lightprobe.reconstruction.surroundings import light_level, pixels_level
from lightprobe.render.asset import Asset, asset_gbuffer
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.surface import visible_surface
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo, Scene

_CPU = torch.device("cpu")
_ELEVATIONS = (-10, 10, 30, 50, 70)  # degrees above the horizon that cameras look down from
_SIDES = 8  # cameras around
_FACTORS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
_PHOTOS, _PIXELS, _SIDE = 20, 1536, 200
_ROUNDS = 3


def camera_from(elevation: float, azimuth: float) -> Camera:
    """Return a camera of 64 x 64 pixels that looks at the origin; angles in degrees."""
    up, around = math.radians(elevation), math.radians(azimuth)
    z = np.array([math.cos(around) * math.cos(up), math.sin(around) * math.cos(up), math.sin(up)])
    x = np.cross([0, 0, 1], z) / math.cos(up)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([x, np.cross(z, x), z], 1), 4 * z
    return Camera(camera_to_world=pose, fx=60, fy=60, cx=32, cy=32, width=64, height=64)


def environment_excess(image: np.ndarray, elevation: float) -> list[float]:
    """Return a map's level over that of what each camera around sees of it; the map is (H, 2H, 3)."""
    light = Environment.from_panorama(image, 16)
    exposed = 0.5 / float(light.mean().mean())
    level = light_level(light.texels * exposed)
    views = [background(image * exposed, camera_from(elevation, 360 * k / _SIDES)) for k in range(_SIDES)]
    return [level - pixels_level(torch.from_numpy(view).reshape(-1, 3)) for view in views]


def photo_excess(asset: Asset, scene: Scene, photo: Photo, config: DecomposeConfig) -> list[float]:
    """Return the levels of lights solved for a photo over that of what it would show, one for each factor."""
    (target,) = load_targets(scene, [photo], _SIDE, _CPU)
    assert photo.truth.environment is not None
    camera = photo.camera.resized(target.view.width, target.view.height)
    seen = background(read_hdr(photo.truth.environment), camera)
    shown = pixels_level(torch.from_numpy(seen).reshape(-1, 3)[target.alpha == 0])
    surface = visible_surface(asset.mesh.vertices, asset.mesh.faces, target.view)
    gbuffer = asset_gbuffer(asset, surface, target.view)
    inside = (target.alpha[gbuffer.pixel] > 0.99).nonzero()[:, 0]
    pixels = gbuffer.select(draw_rows(inside, _PIXELS, generator(0, photo.name)))
    return [light_level(solved(target.color, target.clipped, pixels, f, config)) - shown for f in _FACTORS]


def solved(color: Tensor, clipped: Tensor, pixels: GBuffer, factor: float, config: DecomposeConfig) -> Tensor:
    """Return the light of a photo's `pixels` with base colours times a factor."""
    pixels = brightened(pixels, factor)
    size = config.light_resolution
    grey, pull = torch.full((6, size, size, 3), 0.5), config.final_light_regularisation
    observed, bounds = color[pixels.pixel], clipped[pixels.pixel]
    return solve_target_light(observed, bounds, pixels, grey, None, config, _ROUNDS, regularisation=pull)


def _row(name: str, values: Iterable[Sequence[float]]) -> list[str]:
    """Return a name and the mean and standard deviation of each column's values."""
    return [name, *(f"{np.mean(v):+.2f} ± {np.std(v):.2f}" for v in values)]


@torch.no_grad()
def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("hdris", type=Path, metavar="HDRIS")
    parser.add_argument("scenes", type=Path, nargs="*", metavar="SCENE")
    given = parser.parse_args(arguments)
    maps = [read_hdr(path)[..., :3] for path in environment_files(given.hdris)]
    found = [[environment_excess(image, elevation) for image in maps] for elevation in _ELEVATIONS]
    between = _row("between maps", [[float(np.mean(one)) for one in maps_of] for maps_of in found])
    within = _row(
        "within one", [[v - float(np.mean(one)) for one in maps_of for v in one] for maps_of in found]
    )
    print("\n".join(markdown_table(["", *(f"{elevation}°" for elevation in _ELEVATIONS)], [between, within])))
    config, rows = settings(Preset.QUICK).decompose, []
    for folder in given.scenes:
        scene = load_scene(folder)
        asset, photos = true_asset(scene), scene.train[:: max(1, len(scene.train) // _PHOTOS)][:_PHOTOS]
        values = [photo_excess(asset, scene, photo, config) for photo in photos]
        rows.append(_row(folder.name, zip(*values, strict=True)))
    if rows:
        print(
            "\n" + "\n".join(markdown_table(["object", *(f"times {factor:g}" for factor in _FACTORS)], rows))
        )


if __name__ == "__main__":
    main()

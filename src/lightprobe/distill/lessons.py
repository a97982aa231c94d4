"""What the training loop looks at: each photo's pixels on the fixed asset, and its Phase I environment as the teacher.

Everything that does not change while training is computed here once: the G-buffer, the photo's light level, the
distribution of all its pixels, and the teacher at the training resolution.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.config_distill import DistillConfig
from lightprobe.core.device import generator
from lightprobe.core.errors import InputError
from lightprobe.distill.probe_distribution import mean_distribution
from lightprobe.distill.probe_pixels import ProbePixels, probe_pixels
from lightprobe.light import cubemap
from lightprobe.light.resize import resize_light
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.scene import load_pixels
from lightprobe.scene.photo import Photo, Scene

_OPAQUE = 0.9  # below this coverage a pixel's colour is partly extrapolated from its neighbours
_FEWEST_PIXELS = 16


@dataclass(frozen=True)
class Lesson:
    """One training photo with M texels of teacher light, all on the training device."""

    name: str
    pixels: ProbePixels  # N pixels, linear colour in the photo's own exposure
    light_level: Tensor  # () radiance
    distribution: Tensor  # (M,) mean distribution of all pixels
    teacher: Tensor  # (M, 3) radiance / light_level


def collect_lessons(
    asset: Asset, lights: Mapping[str, Tensor], scene: Scene, config: DistillConfig, device: torch.device, seed: int
) -> list[Lesson]:
    """Return a lesson for each training photo that has a light and shows the object, in the scene's order.

    Raises `InputError` when no photo does.
    """
    directions = cubemap.directions(config.light_resolution, device).reshape(-1, 3)
    lessons = []
    for photo in scene.train:
        if photo.name not in lights:
            continue
        pixels = _photo_pixels(asset, photo, scene, config, device, seed)
        if len(pixels) < _FEWEST_PIXELS:
            continue
        level = pixels.light_level()
        teacher = resize_light(lights[photo.name].to(device), config.light_resolution).reshape(-1, 3) / level
        total = mean_distribution(pixels, directions, config.alpha_rule)
        lessons.append(Lesson(photo.name, pixels, level, total, teacher))
    if not lessons:
        raise InputError(
            f"None of the {len(scene.train)} training photos in {scene.root} shows the reconstructed object; "
            "look at the masks and poses with `lightprobe inspect`."
        )
    return lessons


def _photo_pixels(
    asset: Asset, photo: Photo, scene: Scene, config: DistillConfig, device: torch.device, seed: int
) -> ProbePixels:
    """Return at most `pixels_per_photo` of the photo's object pixels, chosen at random."""
    loaded, camera = load_pixels(photo, config.max_side)
    gbuffer = rasterize_asset(asset, camera.normalised(scene.similarity), device)
    opaque = torch.from_numpy(loaded.alpha).to(device).reshape(-1)[gbuffer.pixel] >= _OPAQUE
    rows = opaque.nonzero()[:, 0]
    if len(rows) > config.pixels_per_photo:
        order = torch.randperm(len(rows), generator=generator(seed, f"distill-keep/{photo.name}"))
        rows = rows[order[: config.pixels_per_photo].sort().values.to(device)]
    color = torch.from_numpy(loaded.color).to(device).reshape(-1, 3)[gbuffer.pixel[rows]]
    return probe_pixels(gbuffer, rows, color)

"""One photo to learn from: its pixels on the fixed asset, and the light it was taken in."""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.config.distillation import DistillConfig
from lightprobe.light import cubemap
from lightprobe.light.resize import resize_light
from lightprobe.models.probe_distribution import total_distribution
from lightprobe.models.probe_maps import SOLVED_PIXELS, coarse_lights
from lightprobe.models.probe_pixels import ProbePixels, probe_pixels
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.gbuffer import GBuffer


@dataclass(frozen=True)
class Lesson:
    """One photo with M texels of its light, all on the training device."""

    name: str
    pixels: ProbePixels  # N pixels, linear colour in the photo's own exposure
    clipped: Tensor  # (N, 3) bool
    light_level: Tensor  # () radiance
    distribution: Tensor  # (M,) distribution of all pixels, the divisor of the sample weight
    solved: Tensor  # (2, 384, 3) from `probe_maps.coarse_lights`
    up: Tensor  # (3,) unit, for most of the cameras
    teacher: Tensor  # (M, 3) radiance / light_level

    def to(self, device: torch.device) -> "Lesson":
        """Return the lesson on `device`."""
        return Lesson(
            self.name,
            self.pixels.to(device),
            self.clipped.to(device),
            self.light_level.to(device),
            self.distribution.to(device),
            self.solved.to(device),
            self.up.to(device),
            self.teacher.to(device),
        )


class LessonMaker:
    """One camera's view of the asset, from which any number of lessons under different lights are made."""

    def __init__(self, gbuffer: GBuffer, up: Tensor, config: DistillConfig):
        """Take the G-buffer of the N pixels of all lessons, in any order, and the direction (3,) that is up."""
        self.gbuffer, self.config = gbuffer, config
        self.up = up.to(gbuffer.normal.device)
        some = -(-len(gbuffer.pixel) // SOLVED_PIXELS)
        self._some = torch.arange(0, len(gbuffer.pixel), some, device=gbuffer.pixel.device)
        self._transport = CoarseTransport.of(gbuffer.select(self._some))
        rows = torch.arange(len(gbuffer.pixel), device=gbuffer.pixel.device)
        self._pixels = probe_pixels(gbuffer, rows, torch.zeros_like(gbuffer.base_color))
        directions = cubemap.directions(config.light_resolution, rows.device).reshape(-1, 3)
        self._distribution = total_distribution(
            self._pixels, directions, config.alpha_rule, config.total_distribution, config.samples
        )

    def lesson(
        self, name: str, color: Tensor, clipped: Tensor, light: Tensor, exposure: Tensor | float = 1.0
    ) -> Lesson:
        """Return the lesson of a photo taken in `light` (6, R, R, 3) times `exposure`.

        color (N, 3): its linear colours; clipped (N, 3) bool: which of them are only bounds from below.
        """
        pixels = self._pixels.photographed(color)
        level = pixels.light_level()
        side = self.config.light_resolution
        teacher = (resize_light(light, side) * exposure).reshape(-1, 3) / level
        solved = coarse_lights(self._transport, color[self._some], level)
        return Lesson(name, pixels, clipped, level, self._distribution, solved, self.up, teacher)

"""Training examples without limit: the asset in the training cameras, re-rendered under known lights.

    light pool (lights of the photos turned and mixed, generated places, a folder of maps)
      -> the asset with small errors  -> exposure, noise, clipping, 8 bits -> an example on the asset without
      them

The errors are why the pairs teach more than an inversion: what a wrong normal or roughness does to a photo is
noise to a predictor that believes the asset, and the examples say how much of it to expect.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from lightprobe.core.device import generator
from lightprobe.distillation.draw import Draw, beside, upright
from lightprobe.distillation.generated_lights import generated_light
from lightprobe.imaging import srgb_decode, srgb_encode
from lightprobe.light import prefilter
from lightprobe.light.environment import Environment
from lightprobe.light.photometry import USUAL_MEAN
from lightprobe.light.resize import rotate_light
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import furnace, shade


class LightPool:
    """Lights for examples, drawn by number."""

    def __init__(
        self,
        up: Tensor,
        photo_lights: Sequence[Environment],
        maps: Sequence[Environment],
        resolution: int,
        seed: int,
        device: torch.device | None = None,
    ):
        """Take the up direction (3,), Phase I's lights and the user's maps, of any resolution.

        Of every ten lights about five are the user's maps, three generated and two of Phase I; without maps
        six and four. device: where lights are made, by default the CPU.
        """
        self.device = device or torch.device("cpu")
        self.up = up.cpu()
        self.photo_lights = [light.to(self.device).texels for light in photo_lights]
        self.maps = [light.to(self.device).texels for light in maps]
        self.resolution, self.seed = resolution, seed

    def light(self, index: int) -> Tensor:
        """Return light number `index`, (6, R, R, 3) on the pool's device; its scale means nothing."""
        draw = Draw(generator(self.seed, "light-pool", index))
        kind = draw.uniform(0, 1)
        from_maps = 0.5 if self.maps else 0.0
        if kind < from_maps:
            return self._turned(self.maps, torch.eye(3)[2], draw)
        if kind < from_maps + 0.4 * (1 - from_maps) and self.photo_lights:
            return self._turned(self.photo_lights, self.up, draw)
        return generated_light(self.resolution, seed=self.seed, step=index, up=self.up, device=self.device)

    def _turned(self, lights: list[Tensor], up: Tensor, draw: Draw) -> Tensor:
        """Return one of the lights, or a mix of two, turned about their vertical `up` (3,) and tinted."""
        total = torch.zeros(6, self.resolution, self.resolution, 3, device=self.device)
        for _ in range(1 if draw.uniform(0, 1) < 0.7 else 2):
            light = lights[draw.count(0, len(lights) - 1)]
            turn = upright(up, 0.0).T @ upright(self.up, draw.uniform(0, 2 * math.pi))
            turned = rotate_light(light / light.mean().clamp(min=1e-9), beside(turn, light), self.resolution)
            total += draw.uniform(0.3, 1) * turned
        return total * beside(torch.exp(draw.normal(3) * torch.tensor([0.12, 0.05, 0.15])), total)


def erroneous(gbuffer: GBuffer, draw: Draw) -> GBuffer:
    """Return the G-buffer as it might truly be: with smooth errors of normal, roughness and base colour.

    About as large as those of assets reconstructed from photos; some examples have small ones and some large.
    """
    position, size = gbuffer.position, draw.scale(0.4, 1.6)

    def smooth(frequency: float, columns: int) -> Tensor:
        return torch.stack([draw.noise(position, frequency) for _ in range(columns)], 1).to(gbuffer.normal)

    normal = torch.nn.functional.normalize(gbuffer.normal + 0.06 * size * smooth(12.0, 3), dim=1)
    roughness = gbuffer.roughness * torch.exp(
        size * (0.15 * smooth(6.0, 1)[:, 0] + 0.2 * float(draw.normal(1)))
    )
    shade_error = 0.12 * smooth(10.0, 1) + 0.05 * smooth(8.0, 3) + 0.3 * float(draw.normal(1))
    color = (gbuffer.base_color * torch.exp(size * shade_error)).clamp(0.01, 0.95)
    return replace(gbuffer, normal=normal, roughness=roughness.clamp(0.08, 1.0), base_color=color)


def photograph(radiance: Tensor, draw: Draw) -> tuple[Tensor, float]:
    """Return the colours (P, 3) that an 8-bit photo shows of linear `radiance` (P, 3), and its exposure."""
    luminance = radiance.mean(1)
    exposure = USUAL_MEAN / float(luminance.minimum(4 * luminance.median()).mean().clamp(min=1e-9))
    exposure *= 2 ** draw.uniform(-0.8, 0.8)
    noise = beside(draw.normal(2, *radiance.shape), radiance)
    exposed = radiance * exposure * (1 + 0.03 * noise[0]) + 0.002 * noise[1]
    return srgb_decode((srgb_encode(exposed.clamp(0, 1)) * 255).round() / 255), exposure


@torch.no_grad()
def rerender(gbuffer: GBuffer, light: Tensor, draw: Draw) -> tuple[Tensor, Tensor]:
    """Return colours (P, 3) of a photo of the asset in `light` (6, R, R, 3), and the factors (3,) on that
    light.

    The factors are exposure times what the errors of the base colour do to the brightness: light and surface
    share a factor that no photo tells apart, and the example's light is the one that goes with the asset as
    it is believed.
    """
    true = erroneous(gbuffer, draw)
    operator = prefilter.cached(light.shape[1], gbuffer.normal.device)
    light = light.to(gbuffer.normal.device)
    color, exposure = photograph(shade(true, operator, operator.apply(light)), draw)
    return color, exposure * furnace(true).sum(0) / furnace(gbuffer).sum(0).clamp(min=1e-9)

"""The pixels of one photo as light probes: what was seen, on which material, from where.

Notation: c linear colour, k_d base colour, k_s = F0, n normal, r roughness, w_o view direction (surface ->
camera); furnace: the pixel's colour under a constant environment of radiance 1, so c / furnace is the average
light a pixel saw.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from lightprobe.core.device import generator, to_device
from lightprobe.light.photometry import luma
from lightprobe.render.brdf import base_reflectance
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import furnace

_LEAST_WEIGHT = 1e-3  # keeps perfectly rough pixels in the draw: a wholly matte object has probes, too


@dataclass(frozen=True)
class ProbePixels:
    """N pixels; all float32 on one device."""

    color: Tensor  # (N, 3) linear, straight
    base_color: Tensor  # (N, 3) linear
    specular: Tensor  # (N, 3) F0
    normal: Tensor  # (N, 3) unit
    view: Tensor  # (N, 3) unit, surface -> camera
    roughness: Tensor  # (N,)
    furnace: Tensor  # (N, 3)

    def __len__(self) -> int:
        return len(self.color)

    def tensors(self) -> tuple[Tensor, ...]:
        """Return the fields, in order, as in `ProbePixels`."""
        return tuple(getattr(self, field.name) for field in fields(self))

    def take(self, index: Tensor) -> "ProbePixels":
        """Return the pixels at `index` (K,) int64."""
        return ProbePixels(*(value[index] for value in self.tensors()))

    def to(self, device: torch.device) -> "ProbePixels":
        """Return the pixels on `device`."""
        return ProbePixels(*(value.to(device) for value in self.tensors()))

    def photographed(self, color: Tensor) -> "ProbePixels":
        """Return the same surface points in a photo in which they have the linear `color` (N, 3)."""
        return replace(self, color=color)

    @staticmethod
    def joined(parts: Sequence["ProbePixels"]) -> "ProbePixels":
        """Return the pixels of several photos, one photo's after the other's."""
        return ProbePixels(
            *(torch.cat(values) for values in zip(*(part.tensors() for part in parts), strict=True))
        )

    def light_level(self) -> Tensor:
        """Return the grey radiance () that, from everywhere, would give the pixels their summed luma; at
        least 1e-6.

        It carries the photo's exposure: everything learned is relative to it.
        """
        return (luma(self.color).sum() / luma(self.furnace).sum().clamp_min(1e-6)).clamp_min(1e-6)


def probe_pixels(gbuffer: GBuffer, rows: Tensor, color: Tensor) -> ProbePixels:
    """Return the pixels at `rows` (N,) int64 of a G-buffer, photographed as `color` (N, 3); no gradients."""
    with torch.no_grad():
        g = gbuffer.select(rows)
        specular = base_reflectance(g.base_color, g.metallic)
        return ProbePixels(color, g.base_color, specular, g.normal, g.view, g.roughness, furnace(g))


def sample_pixels(roughness: Tensor, count: int, *, seed: int, stream: str, step: int = 0) -> Tensor:
    """Return `count` distinct pixel indices (count,) int64 drawn with probability proportional to 1 - r.

    roughness: (N,) in [0, 1]. stream, step: name of the random stream of a run's `seed`, and the number
    within it. All N indices are returned when `count` >= N.

    The paper (section 3.2.3) asks for more smooth pixels than rough ones; its |r - 1| - 1 is read as |r - 1|,
    as no probability is negative. Adding Gumbel noise to the log weights and taking the largest draws one
    pixel after the other without replacement.
    """
    if count >= len(roughness):
        return torch.arange(len(roughness), device=roughness.device)
    weight = (1 - roughness.detach()).clamp_min(_LEAST_WEIGHT).double()
    uniform = torch.rand(len(weight), dtype=torch.float64, generator=generator(seed, stream, step))
    gumbel = -torch.log(-torch.log(uniform.clamp(1e-300, 1 - 1e-16)))
    return torch.topk(weight.log() + to_device(gumbel, roughness.device), count, sorted=True).indices

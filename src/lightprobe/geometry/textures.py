"""The material as textures: storage, bilinear look-up, and the tangent-space normal map.

Texel (row i, column j) covers uv ((j + 0.5) / size, (i + 0.5) / size); v points down, as in glTF. Channels stand in
this order everywhere: base colour 3 (linear), roughness, metallic, normal 3.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.kernels import weighted_gather

CHANNELS = 8


@dataclass(frozen=True)
class Textures:
    """Square textures of a glTF metallic-roughness material."""

    base_color: Tensor  # (S, S, 3) float32, linear
    roughness: Tensor  # (S, S)
    metallic: Tensor  # (S, S)
    normal: Tensor  # (S, S, 3) tangent-space unit vectors, z outwards

    @property
    def size(self) -> int:
        """Texels per edge."""
        return self.base_color.shape[0]

    def to(self, device: torch.device) -> "Textures":
        """Return the textures on another device."""
        return Textures(*(part.to(device) for part in vars(self).values()))

    def resized(self, size: int) -> "Textures":
        """Return textures of `size` squared texels, interpolated bilinearly."""
        if size == self.size:
            return self
        maps = self.flat().T.reshape(1, 8, self.size, self.size)
        maps = torch.nn.functional.interpolate(maps, (size, size), mode="bilinear", antialias=True)
        return Textures.of_bent(maps[0].reshape(8, -1).T)

    def halfway(self, other: "Textures") -> "Textures":
        """Return the mean of two textures of one size."""
        return Textures.of_bent(0.5 * (self.flat() + other.flat()))

    def flat(self) -> Tensor:
        """Return all channels as (S * S, 8) in the order of this module."""
        channels = (self.base_color, self.roughness[..., None], self.metallic[..., None], self.normal)
        return torch.cat(channels, dim=-1).reshape(-1, 8)

    @staticmethod
    def of_bent(channels: Tensor) -> "Textures":
        """Return textures of (S * S, 8) channels whose normals have lost their unit length."""
        normal = torch.nn.functional.normalize(channels[:, 5:], dim=1)
        return Textures.from_flat(torch.cat([channels[:, :5], normal], 1))

    @staticmethod
    def from_flat(channels: Tensor) -> "Textures":
        """Return textures of (S * S, 8) channels."""
        size = round(channels.shape[0] ** 0.5)
        maps = channels.reshape(size, size, 8)
        return Textures(maps[..., :3], maps[..., 3], maps[..., 4], maps[..., 5:])


def bilinear_taps(uv: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """Return index (N, 4) int32 and weight (N, 4) of the texels around uv (N, 2); clamped at the border.

    Weights are differentiable in uv.
    """
    x = (uv * size - 0.5).clamp(0, size - 1)
    low = x.detach().floor().clamp(max=size - 2)
    fx, fy = (x - low).unbind(1)
    j, i = low.to(torch.int32).unbind(1)
    base = i * size + j
    index = torch.stack([base, base + 1, base + size, base + size + 1], 1)
    weight = torch.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy], 1)
    return index, weight


def sample(flat: Tensor, uv: Tensor) -> Tensor:
    """Return the channels (N, C) of a flat texture (S * S, C) at uv (N, 2)."""
    index, weight = bilinear_taps(uv, round(flat.shape[0] ** 0.5))
    return weighted_gather(flat, index, weight)

"""What each point of a surface sees around it, known before any light: its shadows, and the colour of what casts them.

Per vertex it is found by `render.surroundings`; here it is what the pixels of a view make of it.
"""

import functools
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.kernels import occluded_light, occluded_light_adjoint, weighted_gather
from lightprobe.light import cubemap
from lightprobe.light.prefilter import BLOCKS


@dataclass(frozen=True)
class Surroundings:
    """What each of V vertices sees around it."""

    openness: Tensor  # (V, 384) uint8, the share of each of 6 x 8 x 8 cubemap directions that is open, 0 to 255
    blockers: Tensor  # (V, 3) linear base colour of what blocks the others, averaged by cosine

    def to(self, device: torch.device) -> "Surroundings":
        """Return them on another device."""
        return Surroundings(self.openness.to(device), self.blockers.to(device))

    def brightened(self, factor: float) -> "Surroundings":
        """Return the surroundings with base colours times `factor`."""
        return Surroundings(self.openness, (self.blockers * factor).clamp(max=1))


@dataclass(frozen=True)
class Openness:
    """What P points see around them, as a mix of vertices."""

    around: Surroundings
    index: Tensor  # (P, C) integer vertices
    weight: Tensor  # (P, C) sum to 1

    @staticmethod
    def of(around: Surroundings, faces: Tensor, face: Tensor, barycentric: Tensor) -> "Openness":
        """Return it at points of a mesh with `faces` (F, 3), by face (P,) and barycentric coordinates (P, 3)."""
        return Openness(around, faces[face], barycentric.detach())

    def select(self, rows: Tensor) -> "Openness":
        """Return the points at `rows` (K,) int64."""
        return Openness(self.around, self.index[rows], self.weight[rows])

    def brightened(self, factor: float) -> "Openness":
        """Return it with base colours times `factor`."""
        return Openness(self.around.brightened(factor), self.index, self.weight)

    def light(self, blocks: Tensor, normal: Tensor) -> Tensor:
        """Return `kernels.occluded_light` (P, 7) of the light `blocks` (384, 3), its average over each direction."""
        directions, angles = _sphere(blocks.device, blocks.dtype)
        return occluded_light(blocks, normal, self.around.openness, self.index, self.weight, directions, angles)

    def adjoint(self, diffuse: Tensor, ambient: Tensor, normal: Tensor) -> Tensor:
        """Return the transpose of the first six columns of `light`, (384, 3), on (P, 3) each; not differentiable."""
        directions, angles = _sphere(diffuse.device, diffuse.dtype)
        arriving = torch.cat([diffuse, ambient], 1)
        return occluded_light_adjoint(
            arriving, normal, self.around.openness, self.index, self.weight, directions, angles
        )

    def share(self, normal: Tensor) -> Tensor:
        """Return the open share (P,) of the hemisphere around `normal` (P, 3), weighted by the cosine."""
        return self.light(normal.new_zeros(self.around.openness.shape[1], 3), normal)[:, 6]

    def blockers(self) -> Tensor:
        """Return the base colour (P, 3) of what stands in the way; not differentiable."""
        return weighted_gather(self.around.blockers, self.index, self.weight)

    def towards(self, direction: Tensor) -> Tensor:
        """Return how open (P,) each point is in `direction` (P, 3), in [0, 1]; not differentiable."""
        table = self.around.openness
        texel, share = cubemap.bilinear_taps(direction.detach(), BLOCKS)
        rows = self.index.long()[:, :, None] * table.shape[1] + texel.long()[:, None, :]
        weight = self.weight[:, :, None] * share[:, None, :] / 255
        return (table.reshape(-1)[rows] * weight).sum((1, 2))


def ambient_occlusion(around: Surroundings, normals: Tensor) -> Tensor:
    """Return the cosine-weighted open share (V,) of each vertex with `normals` (V, 3): glTF's occlusion."""
    rows = torch.arange(len(normals), device=normals.device)[:, None]
    return Openness(around, rows, torch.ones_like(rows, dtype=normals.dtype)).share(normals)


@functools.lru_cache(maxsize=8)
def _sphere(device: torch.device, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Return the directions (384, 3) and their solid angles (384,)."""
    directions = cubemap.exact_directions(BLOCKS, device).reshape(-1, 3)
    return directions.to(dtype), cubemap.exact_solid_angles(BLOCKS, device).reshape(-1).to(dtype)

"""Visibility of the environment from a surface: the directions that the object occludes, and its colour.

It depends on the shape alone, and is known before any light. Per vertex it is found by
`render.vertex_visibility`; here it is interpolated at the pixels of a view.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.kernels import occluded_light, occluded_light_adjoint, values_at, weighted_gather
from lightprobe.light import cubemap
from lightprobe.light.prefilter import BLOCKS


@dataclass(frozen=True)
class VertexVisibility:
    """Visibility from V vertices."""

    unoccluded: Tensor  # (V, 384) uint8, the share of each of 6 x 8 x 8 cubemap directions that is not occluded, 0 to 255
    occluder_color: Tensor  # (V, 3) linear mean base colour of the occluders, weighted by cosine

    def to(self, device: torch.device) -> "VertexVisibility":
        """Return it on another device."""
        return VertexVisibility(self.unoccluded.to(device), self.occluder_color.to(device))

    def brightened(self, factor: float) -> "VertexVisibility":
        """Return it with the occluders' base colours times `factor`."""
        return VertexVisibility(self.unoccluded, (self.occluder_color * factor).clamp(max=1))


@dataclass(frozen=True)
class PointVisibility:
    """Visibility from P points, interpolated between vertices."""

    vertices: VertexVisibility
    index: Tensor  # (P, C) integer vertices
    weight: Tensor  # (P, C) sum to 1

    @staticmethod
    def of(vertices: VertexVisibility, faces: Tensor, face: Tensor, barycentric: Tensor) -> "PointVisibility":
        """Return it at points of a mesh with `faces` (F, 3), by face (P,) and barycentric coordinates (P, 3)."""
        return PointVisibility(vertices, faces[face], barycentric.detach())

    def select(self, rows: Tensor) -> "PointVisibility":
        """Return the points at `rows` (K,) int64."""
        return PointVisibility(self.vertices, self.index[rows], self.weight[rows])

    @staticmethod
    def of_all(parts: Sequence["PointVisibility"]) -> "PointVisibility":
        """Return the points of several views of one object, which share its vertices."""
        index, weight = torch.cat([part.index for part in parts]), torch.cat([part.weight for part in parts])
        return PointVisibility(parts[0].vertices, index, weight)

    def brightened(self, factor: float) -> "PointVisibility":
        """Return it with base colours times `factor`."""
        return PointVisibility(self.vertices.brightened(factor), self.index, self.weight)

    def light(self, blocks: Tensor, normal: Tensor) -> Tensor:
        """Return `kernels.occluded_light` (P, 7) of `blocks` (384, 3), a light's averages by direction."""
        directions, angles = _sphere(blocks.device, blocks.dtype)
        return occluded_light(
            blocks, normal, self.vertices.unoccluded, self.index, self.weight, directions, angles
        )

    def adjoint(self, diffuse: Tensor, ambient: Tensor, normal: Tensor) -> Tensor:
        """Return the transpose of `light`'s first six columns, (384, 3), on (P, 3) each; no gradient."""
        directions, angles = _sphere(diffuse.device, diffuse.dtype)
        arriving = torch.cat([diffuse, ambient], 1)
        return occluded_light_adjoint(
            arriving, normal, self.vertices.unoccluded, self.index, self.weight, directions, angles
        )

    def share(self, normal: Tensor) -> Tensor:
        """Return the open share (P,) of the hemisphere around `normal` (P, 3), weighted by the cosine."""
        return self.light(normal.new_zeros(self.vertices.unoccluded.shape[1], 3), normal)[:, 6]

    def occluder_color(self) -> Tensor:
        """Return the base colour (P, 3) of what stands in the way; not differentiable."""
        return weighted_gather(self.vertices.occluder_color, self.index, self.weight)

    def towards(self, direction: Tensor) -> Tensor:
        """Return how open (P,) each point is in `direction` (P, 3), in [0, 1]; not differentiable."""
        table = self.vertices.unoccluded
        texel, share = cubemap.bilinear_taps(direction.detach(), BLOCKS)
        rows = self.index.long()[:, :, None] * table.shape[1] + texel.long()[:, None, :]
        weight = self.weight[:, :, None] * share[:, None, :] / 255
        return (values_at(table.reshape(-1), rows) * weight).sum((1, 2))


def ambient_occlusion(vertices: VertexVisibility, normals: Tensor) -> Tensor:
    """Return the cosine-weighted open share (V,) of each vertex with `normals` (V, 3): glTF's occlusion."""
    rows = torch.arange(len(normals), device=normals.device)[:, None]
    return PointVisibility(vertices, rows, torch.ones_like(rows, dtype=normals.dtype)).share(normals)


@functools.lru_cache(maxsize=8)
def _sphere(device: torch.device, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Return the directions (384, 3) and their solid angles (384,)."""
    directions = cubemap.exact_directions(BLOCKS, device).reshape(-1, 3)
    return directions.to(dtype), cubemap.exact_solid_angles(BLOCKS, device).reshape(-1).to(dtype)

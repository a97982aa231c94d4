"""Which directions each point of a surface has open: the object's own shadows, known before any light is.

The table holds, for every vertex, the share of each of 6 x 8 x 8 cubemap directions that the object does not block
(0 to 255). It is found with one depth map per direction, as for a sun standing there.
"""

import functools
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.kernels import occluded_light, occluded_light_adjoint, rasterize
from lightprobe.light import cubemap
from lightprobe.light.prefilter import BLOCKS

_SIDE = 256  # pixels of a depth map
_BIAS = 1.5  # pixels a vertex is lifted from its surface: less, and faces shadow themselves
_FAR = 50.0  # radii; perspective-correct depth is as good as linear from here
_HORIZON = -0.2  # directions further below a vertex's horizon are blocked, whatever the depth map says


@dataclass(frozen=True)
class Openness:
    """The open directions of P points, as a mix of table rows."""

    table: Tensor  # (V, 384) uint8
    index: Tensor  # (P, C) integer rows of the table
    weight: Tensor  # (P, C) sum to 1

    def select(self, rows: Tensor) -> "Openness":
        """Return the points at `rows` (K,) int64."""
        return Openness(self.table, self.index[rows], self.weight[rows])

    def light(self, blocks: Tensor, normal: Tensor) -> Tensor:
        """Return `kernels.occluded_light` (P, 7) of the light `blocks` (384, 3), its average over each direction."""
        directions, angles = _sphere(blocks.device, blocks.dtype)
        return occluded_light(blocks, normal, self.table, self.index, self.weight, directions, angles)

    def adjoint(self, diffuse: Tensor, ambient: Tensor, normal: Tensor) -> Tensor:
        """Return the transpose of the first six columns of `light`, (384, 3), on (P, 3) each; not differentiable."""
        directions, angles = _sphere(diffuse.device, diffuse.dtype)
        arriving = torch.cat([diffuse, ambient], 1)
        return occluded_light_adjoint(arriving, normal, self.table, self.index, self.weight, directions, angles)

    def share(self, normal: Tensor) -> Tensor:
        """Return the open share (P,) of the hemisphere around `normal` (P, 3), weighted by the cosine."""
        return self.light(normal.new_zeros(self.table.shape[1], 3), normal)[:, 6]

    def towards(self, direction: Tensor) -> Tensor:
        """Return how open (P,) each point is in `direction` (P, 3), in [0, 1]; not differentiable."""
        texel, share = cubemap.bilinear_taps(direction.detach(), BLOCKS)
        rows = self.index.long()[:, :, None] * self.table.shape[1] + texel.long()[:, None, :]
        weight = self.weight[:, :, None] * share[:, None, :] / 255
        return (self.table.reshape(-1)[rows] * weight).sum((1, 2))


@torch.no_grad()
def openness_table(vertices: Tensor, faces: Tensor) -> Tensor:
    """Return the open share (V, 384) uint8 of every direction for the vertices (V, 3) of a mesh (F, 3)."""
    normals = vertex_normals(vertices, faces)
    extent = 1.02 * float(vertices.norm(dim=1).max())
    pixel = 2 * extent / _SIDE
    lifted = vertices + _BIAS * pixel * normals
    above = normals @ cubemap.directions(BLOCKS, vertices.device).reshape(-1, 3).T > _HORIZON
    table = torch.zeros(above.shape, dtype=torch.uint8, device=vertices.device)
    for k, axes in enumerate(_frames(vertices.device)):
        screen = _screen(vertices, axes, extent, pixel)
        inverse = rasterize(screen, faces, _SIDE, _SIDE).inverse_depth
        depth = torch.where(inverse > 0, 1 / inverse, 2 * _FAR).reshape(-1)
        point = _screen(lifted, axes, extent, pixel)
        x, y = ((point[:, :2] - 0.5).clamp(0, _SIDE - 1.001)).unbind(1)
        low_x, low_y = x.floor(), y.floor()
        first = (low_y * _SIDE + low_x).long()
        lit = torch.stack([depth[first + step] for step in (0, 1, _SIDE, _SIDE + 1)], 1) > point[:, 2:] - _BIAS * pixel
        fx, fy = x - low_x, y - low_y
        share = torch.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy], 1)
        table[:, k] = torch.where(above[:, k], 255 * (lit * share).sum(1), 0.0).round().to(torch.uint8)
    return table


def blend(table: Tensor, faces: Tensor, face: Tensor, barycentric: Tensor) -> Openness:
    """Return the openness at points given by face (P,) and barycentric coordinates (P, 3) from per-vertex rows."""
    return Openness(table, faces[face], barycentric.detach())


def ambient_occlusion(table: Tensor, normals: Tensor) -> Tensor:
    """Return the cosine-weighted open share (V,) of each vertex with `normals` (V, 3): glTF's occlusion."""
    rows = torch.arange(len(table), device=table.device)[:, None]
    return Openness(table, rows, torch.ones_like(rows, dtype=normals.dtype)).share(normals)


def _screen(points: Tensor, axes: Tensor, extent: float, pixel: float) -> Tensor:
    """Return points (V, 3) as the rasteriser takes them, seen in parallel from far along the third of `axes` (3, 3)."""
    x, y, z = (points @ axes.T).unbind(1)
    return torch.stack([(x + extent) / pixel, (y + extent) / pixel, _FAR - z], 1)


def _frames(device: torch.device) -> Tensor:
    """Return orthonormal axes (384, 3, 3) whose third row is the direction."""
    third = cubemap.directions(BLOCKS, device).reshape(-1, 3)
    helper = torch.where(third[:, :1].abs() < 0.6, third.new_tensor([1.0, 0, 0]), third.new_tensor([0.0, 1, 0]))
    first = torch.nn.functional.normalize(torch.linalg.cross(third, helper), dim=1)
    return torch.stack([first, torch.linalg.cross(third, first), third], 1)


@functools.lru_cache(maxsize=8)
def _sphere(device: torch.device, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Return the directions (384, 3) and their solid angles (384,)."""
    directions = cubemap.exact_directions(BLOCKS, device).reshape(-1, 3)
    return directions.to(dtype), cubemap.exact_solid_angles(BLOCKS, device).reshape(-1).to(dtype)

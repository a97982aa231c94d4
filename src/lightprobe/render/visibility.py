"""Visibility of the environment from a surface: the directions that the object occludes, and its colour.

It depends on the shape alone, and is known before any light. It is found at vertices or other points of the surface,
from a depth map for each direction, and interpolated at the pixels of a view.
"""

import copy
import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.kernels import occluded_light, occlusion_weights, values_at, weighted_gather
from lightprobe.light import cubemap
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.depth_maps import DepthMaps, frames

SIDE = 512  # pixels of a depth map
_AT_ONCE = 16_384  # points whose weights are held: 50 MB
_HORIZON = -0.2  # directions further below a vertex's horizon are blocked, whatever the depth map says


@dataclass(frozen=True)
class VertexVisibility:
    """Visibility from V vertices."""

    unoccluded: Tensor  # (V, 384) uint8, the open share of each of 6 x 8 x 8 cubemap directions, 0 to 255
    occluder_color: Tensor  # (V, 3) linear mean base colour of the occluders, weighted by cosine

    def to(self, device: torch.device) -> "VertexVisibility":
        """Return the visibility on another device."""
        return VertexVisibility(self.unoccluded.to(device), self.occluder_color.to(device))

    def brightened(self, factor: float) -> "VertexVisibility":
        """Return the visibility with the occluders' base colours times `factor`."""
        return VertexVisibility(self.unoccluded, (self.occluder_color * factor).clamp(max=1))


@dataclass(frozen=True)
class PointVisibility:
    """Visibility from P points, interpolated between vertices."""

    vertices: VertexVisibility
    index: Tensor  # (P, C) integer vertices
    weight: Tensor  # (P, C) sum to 1

    @staticmethod
    def of(vertices: VertexVisibility, faces: Tensor, face: Tensor, barycentric: Tensor) -> "PointVisibility":
        """Return the visibility at points of `faces` (F, 3), by face (P,) and barycentric coordinates (P, 3)."""
        return PointVisibility(vertices, faces[face], barycentric.detach())

    def select(self, rows: Tensor | slice) -> "PointVisibility":
        """Return the points at `rows` (K,) int64, or of a slice."""
        return PointVisibility(self.vertices, self.index[rows], self.weight[rows])

    @staticmethod
    def of_all(parts: Sequence["PointVisibility"]) -> "PointVisibility":
        """Return the points of several views of one object, which share its vertices."""
        index, weight = torch.cat([part.index for part in parts]), torch.cat([part.weight for part in parts])
        return PointVisibility(parts[0].vertices, index, weight)

    def brightened(self, factor: float) -> "PointVisibility":
        """Return the visibility with base colours times `factor`."""
        return PointVisibility(self.vertices.brightened(factor), self.index, self.weight)

    def light(self, blocks: Tensor, normal: Tensor) -> Tensor:
        """Return `kernels.occluded_light` (P, 7) of `blocks` (384, 3), a light's averages by direction."""
        points = normal, self.vertices.unoccluded, self.index, self.weight
        return occluded_light(blocks, *points, *_sphere(blocks.device, blocks.dtype))

    def weights(self, normal: Tensor) -> Tensor:
        """Return `kernels.occlusion_weights` (2, P, 384): `light`'s first six columns as matrices; no gradient."""
        points = normal, self.vertices.unoccluded, self.index, self.weight
        return occlusion_weights(*points, *_sphere(normal.device, normal.dtype))

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


class OpenLight:
    """The diffuse and ambient light that reaches P points past the object, as a linear map of a light's blocks.

    Its matrices are held, for many lights one after the other, unless there are too many points.
    """

    def __init__(self, visibility: PointVisibility, normal: Tensor):
        """Take points and their normals (P, 3)."""
        self._visibility, self._normal = visibility, normal
        self._held = visibility.weights(normal) if len(normal) <= _AT_ONCE else None

    def select(self, rows: Tensor) -> "OpenLight":
        """Return the map of the points at `rows` (K,) int64."""
        part = copy.copy(self)
        part._visibility, part._normal = self._visibility.select(rows), self._normal[rows]
        part._held = None if self._held is None else self._held[:, rows]
        return part

    def apply(self, blocks: Tensor) -> Tensor:
        """Return `PointVisibility.light`'s diffuse and ambient light, (2, P, 3), of blocks (384, 3); no gradient."""
        return torch.cat([weights @ blocks for _, weights in self._weights()], 1)

    def adjoint(self, arriving: Tensor) -> Tensor:
        """Return the transpose of `apply`, (384, 3), on (2, P, 3)."""
        parts = [arriving[:, rows].reshape(-1, 3).T @ w.flatten(0, 1) for rows, w in self._weights()]
        return sum(parts[1:], parts[0]).T  # the other order of factors would take twice as long

    def _weights(self) -> Iterator[tuple[slice, Tensor]]:
        """Yield points and their matrices (2, K, 384)."""
        if self._held is not None:
            yield slice(None), self._held
            return
        for start in range(0, len(self._normal), _AT_ONCE):
            rows = slice(start, start + _AT_ONCE)
            yield rows, self._visibility.select(rows).weights(self._normal[rows])


def vertex_visibility(vertices: Tensor, faces: Tensor, colors: Tensor, side: int = SIDE) -> VertexVisibility:
    """Return what the vertices (V, 3) of a mesh with base colours (F, 3) see; `side`: pixels of a depth map.

    Where nothing is blocked, the mean colour stands for the blockers', to no effect.
    """
    return point_visibility(vertices, faces, colors, vertices, vertex_normals(vertices, faces), side)


@torch.no_grad()
def point_visibility(
    vertices: Tensor,
    faces: Tensor,
    colors: Tensor,
    points: Tensor,
    normals: Tensor,
    side: int = SIDE,
    *,
    asked: Tensor | None = None,
) -> VertexVisibility:
    """Return what surface points (P, 3) with unit normals (P, 3) see past a mesh, their own or another.

    vertices (V, 3), about the origin, faces (F, 3) and base colours (F, 3): the mesh; `side`: pixels of a depth
    map, of which there is one for each direction. asked (384,) bool: directions in which the mesh can be in the
    way, by default all.
    """
    maps = DepthMaps.of(vertices, faces, points, normals, side)
    directions = cubemap.directions(BLOCKS, vertices.device).reshape(-1, 3)
    cosine = directions @ normals.T
    weight = cosine.clamp(min=0) * cubemap.solid_angles(BLOCKS, vertices.device).reshape(-1, 1)
    table = torch.zeros(cosine.shape, dtype=torch.uint8, device=vertices.device)
    # A trace of the mean colour stands for blockers that are not there.
    total, reflected = torch.full_like(points[:, :1], 1e-6), 1e-6 * colors.mean(0).expand_as(points)
    for k, axes in enumerate(frames(directions)):
        if asked is not None and not asked[k]:
            table[k] = 255 * (cosine[k] > _HORIZON)
            continue
        lit, blocker = maps.visibility(axes)
        lit = torch.where(cosine[k] > _HORIZON, lit, 0.0)
        table[k] = (255 * lit).round().to(torch.uint8)
        blocked = (weight[k] * (1 - lit) * (blocker >= 0))[:, None]
        total += blocked
        reflected = torch.addcmul(reflected, blocked, colors.index_select(0, blocker.clamp(min=0)))
    return VertexVisibility(table.T.contiguous(), reflected / total)


def ambient_occlusion(vertices: VertexVisibility, normals: Tensor) -> Tensor:
    """Return the cosine-weighted open share (V,) of each vertex with `normals` (V, 3): glTF's occlusion."""
    rows = torch.arange(len(normals), device=normals.device)[:, None]
    return PointVisibility(vertices, rows, torch.ones_like(rows, dtype=normals.dtype)).share(normals)


@functools.lru_cache(maxsize=8)
def _sphere(device: torch.device, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Return the directions (384, 3) and their solid angles (384,)."""
    directions = cubemap.exact_directions(BLOCKS, device).reshape(-1, 3)
    return directions.to(dtype), cubemap.exact_solid_angles(BLOCKS, device).reshape(-1).to(dtype)

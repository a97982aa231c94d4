"""What the virtual and the known object see of the sky past themselves and each other, and of the ground's
light.

Visibility is known at points of the surface (`render.visibility`): at vertices, of many close ones only at
some, and at a grid of points on each large triangle.

The ground fills the directions below the horizon. Where shadows fall on it, it gives less: a direction below
the horizon counts as open to the share of light that the ground has where the direction meets it.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.geometry.mesh import decimate
from lightprobe.insertion.virtual_object import VirtualObject
from lightprobe.light import cubemap
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.depth_maps import frames
from lightprobe.render.visibility import VertexVisibility, ambient_occlusion, point_visibility

_POINTS = 40_000  # of visibility, about; more are thinned out
_CASTER_FACES = 20_000  # of a mesh that casts shadows; finer ones are simplified
_SIDE = 384  # pixels of a depth map
_EDGE = 0.06  # of the virtual object's extent, from which triangles get a grid of their own
_FINEST = 24  # grid cells along the edge of a triangle


@dataclass(frozen=True)
class SurfacePoints:
    """Where a virtual object's visibility is known, and how to interpolate between these points."""

    points: Tensor  # (N, 3)
    normals: Tensor  # (N, 3)
    vertex: Tensor  # (V,) int64: the point that stands for each vertex
    cells: Tensor  # (F,) int64: grid cells along the edges of each face; 1: its vertices do
    first: Tensor  # (F,) int64: first point of the face's own grid
    faces: Tensor  # (F, 3)

    @staticmethod
    def of(virtual: VirtualObject) -> "SurfacePoints":
        """Return the points of a placed virtual object, on its device."""
        corners, normals = (values[virtual.faces.long()] for values in (virtual.vertices, virtual.normals))
        extent = float((virtual.vertices.amax(0) - virtual.vertices.amin(0)).norm())
        longest = (corners - corners.roll(1, 1)).norm(dim=2).amax(1)
        cells = torch.ceil(longest / (_EDGE * extent)).long().clamp(1, _FINEST)
        vertex, kept = _thinned(virtual, extent)
        count = torch.where(cells > 1, (cells + 1) * (cells + 2) // 2, 0)
        first = len(kept) + torch.cumsum(count, 0) - count
        points, bent = [virtual.vertices[kept]], [virtual.normals[kept]]
        places = [torch.arange(len(kept), device=first.device)]
        for n in torch.unique(cells[cells > 1]).tolist():
            own = (cells == n).nonzero()[:, 0]
            weights = _grid(n).to(corners)
            points.append(torch.einsum("gc,fcx->fgx", weights, corners[own]).reshape(-1, 3))
            bent.append(torch.einsum("gc,fcx->fgx", weights, normals[own]).reshape(-1, 3))
            places.append((first[own][:, None] + torch.arange(len(weights), device=first.device)).reshape(-1))
        order, every, leaning = (torch.cat(parts) for parts in (places, points, bent))
        unit = torch.empty_like(leaning).index_copy_(0, order, leaning)
        unit = torch.nn.functional.normalize(unit, dim=1, eps=1e-12)
        every = torch.empty_like(every).index_copy_(0, order, every)
        return SurfacePoints(every, unit, vertex, cells, first, virtual.faces.long())

    def taps(self, face: Tensor, barycentric: Tensor) -> tuple[Tensor, Tensor]:
        """Return points (P, 3) int64 and weights (P, 3) at faces (P,) and barycentric coordinates (P, 3)."""
        n, start = self.cells[face], self.first[face]
        x, y = (barycentric[:, 1:] * n[:, None]).clamp(min=0).unbind(1)
        i = torch.minimum(x.floor().long(), n - 1)
        j = torch.minimum(y.floor().long(), n - 1 - i).clamp(min=0)
        fx, fy = (x - i).clamp(0, 1), (y - j).clamp(0, 1)
        upper = (fx + fy > 1) & (i + j < n - 1)

        def point(a: Tensor, b: Tensor) -> Tensor:
            return start + a * (n + 1) - a * (a - 1) // 2 + b

        low = torch.stack([point(i, j), point(i + 1, j), point(i, j + 1)], 1)
        high = torch.stack([point(i + 1, j + 1), point(i, j + 1), point(i + 1, j)], 1)
        inner = torch.stack([(1 - fx - fy).clamp(min=0), fx, fy], 1)
        outer = torch.stack([fx + fy - 1, 1 - fx, 1 - fy], 1)
        index, weight = torch.where(upper[:, None], high, low), torch.where(upper[:, None], outer, inner)
        weight = weight / weight.sum(1, keepdim=True).clamp(min=1e-9)
        single = (n == 1)[:, None]
        index = torch.where(single, self.vertex[self.faces[face]], index)
        return index, torch.where(single, barycentric, weight)


def _grid(n: int) -> Tensor:
    """Return the barycentric coordinates (G, 3) of a triangle's grid points, n cells along its edges."""
    pairs = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    i, j = torch.tensor(pairs, dtype=torch.float32).T / n
    return torch.stack([1 - i - j, i, j], 1)


def _thinned(virtual: VirtualObject, extent: float) -> tuple[Tensor, Tensor]:
    """Return for each vertex the kept one that stands for it (V,), and which are kept (N,).

    Vertices of one small cube of space whose normals look into one octant are one.
    """
    count = len(virtual.vertices)
    if count <= _POINTS:
        every = torch.arange(count, device=virtual.vertices.device)
        return every, every
    cell = extent / np.sqrt(_POINTS)  # surfaces fill about as many cells as their area asks for
    low = virtual.vertices.amin(0)
    key = ((virtual.vertices - low) / cell).long()
    octant = ((virtual.normals > 0).long() * torch.tensor([1, 2, 4], device=key.device)).sum(1)
    side = int(key.max()) + 1
    flat = ((key[:, 0] * side + key[:, 1]) * side + key[:, 2]) * 8 + octant
    _, inverse = torch.unique(flat, return_inverse=True)
    kept = torch.full((int(inverse.max()) + 1,), count, device=key.device)
    kept = kept.scatter_reduce(0, inverse, torch.arange(count, device=key.device), "amin")
    return inverse, kept


def simplified(vertices: Tensor, faces: Tensor, colors: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return a mesh (V, 3), (F, 3) with face colours (F, 3) for casting shadows: of at most about 20 000
    faces.

    Vertices at one point are joined: a solid is then closed, and only its faces towards a light need be
    drawn.
    """
    points, index = np.unique(vertices.cpu().numpy() + 0.0, axis=0, return_inverse=True)
    welded = index.reshape(-1)[faces.cpu().numpy()].astype(np.int32)
    device = vertices.device
    if len(faces) <= _CASTER_FACES:
        return torch.from_numpy(points).to(device), torch.from_numpy(welded).to(device), colors
    v, f = decimate(points, welded, _CASTER_FACES)
    middles = vertices[faces.long()].mean(1).cpu().numpy()
    nearest = scipy.spatial.cKDTree(middles).query(v[f].mean(1))[1]
    chosen = colors[torch.from_numpy(nearest).to(device)]
    return torch.from_numpy(v).to(device), torch.from_numpy(f).to(device), chosen


def past(
    vertices: Tensor, faces: Tensor, colors: Tensor, points: Tensor, normals: Tensor
) -> VertexVisibility:
    """Return what points (N, 3), normals (N, 3) see past a mesh (V, 3), (F, 3), colours (F, 3), wherever it
    is.
    """
    middle = (vertices.amin(0) + vertices.amax(0)) / 2
    asked = _can_block(vertices, points)
    return point_visibility(vertices - middle, faces, colors, points - middle, normals, _SIDE, asked=asked)


def _can_block(vertices: Tensor, points: Tensor) -> Tensor:
    """Return in which directions (384,) bool a mesh (V, 3) can be in the way of points (N, 3).

    Along such a direction their bounding rectangles overlap, and the mesh is not all behind; where a
    horizontal line separates mesh and points, the direction leads to the mesh's side.
    """
    directions = cubemap.directions(BLOCKS, points.device).reshape(-1, 3)
    axes = frames(directions).reshape(-1, 3)
    mesh, own = vertices @ axes.T, points @ axes.T  # (V, 3 * 384)
    overlap = ((mesh.amax(0) >= own.amin(0)) & (mesh.amin(0) <= own.amax(0))).reshape(-1, 3)[:, :2].all(1)
    ahead = (mesh.amax(0) >= own.amin(0)).reshape(-1, 3)[:, 2]
    between = vertices.mean(0) - points.mean(0)
    between = torch.cat([between[:2], between.new_zeros(1)])
    apart = bool((vertices @ between).amin() > (points @ between).amax())
    return overlap & ahead & ((directions @ between > 0) | (not apart))


def both(one: VertexVisibility, other: VertexVisibility, normals: Tensor) -> VertexVisibility:
    """Return what points with normals (N, 3) see past two meshes."""
    open_ = (one.unoccluded.float() * other.unoccluded.float() / 255).round().to(torch.uint8)
    shares = [1 - ambient_occlusion(each, normals)[:, None] for each in (one, other)]
    colors = shares[0] * one.occluder_color + shares[1] * other.occluder_color
    plain = 0.5 * (one.occluder_color + other.occluder_color)
    total = shares[0] + shares[1]
    return VertexVisibility(open_, torch.where(total > 1e-3, colors / total.clamp(min=1e-6), plain))


@dataclass(frozen=True)
class GroundPlan:
    """A square of ground around both objects, and the share of the open ground's light at its points."""

    corner: Tensor  # (2,)
    cell: float
    height: float  # of the ground
    share: Tensor  # (S, S) at most 1

    def at(self, points: Tensor) -> Tensor:
        """Return the share (...,) at ground points (..., 2); 1 outside of the square."""
        side = self.share.shape[0]
        place = (points - self.corner) / self.cell
        grid = (2 * place / side - 1).reshape(1, 1, -1, 2)
        lost = torch.nn.functional.grid_sample((1 - self.share)[None, None], grid, align_corners=False)
        return 1 - lost.reshape(points.shape[:-1])


def over_ground(
    visibility: VertexVisibility, points: Tensor, normals: Tensor, plan: GroundPlan
) -> VertexVisibility:
    """Return the visibility of points (N, 3), normals (N, 3) with the shadows on the ground below the
    horizon.

    The light that these shadows take is not given back as light off other surfaces.
    """
    directions = cubemap.directions(BLOCKS, points.device).reshape(-1, 3)
    below = (directions[:, 2] < 0).nonzero()[:, 0]
    table = visibility.unoccluded.clone()
    above = (points[:, 2] - plan.height).clamp(min=0)
    for k in below.tolist():
        d = directions[k]
        share = plan.at(points[:, :2] + above[:, None] * (d[:2] / -d[2]))
        table[:, k] = (table[:, k].float() * share).round().to(torch.uint8)
    shaded = replace(visibility, unoccluded=table)
    before, after = (1 - ambient_occlusion(each, normals)[:, None] for each in (visibility, shaded))
    kept = torch.where(after > 1e-3, before / after.clamp(min=1e-6), 1.0).clamp(0, 1)
    return replace(shaded, occluder_color=visibility.occluder_color * kept)

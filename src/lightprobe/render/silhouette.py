"""Anti-aliased silhouettes whose coverage carries the gradient to the geometry.

Where the outline of the mesh passes between two neighbouring pixel centres, one of them covered, it does so
at a distance t (in pixels, 0..1) from the covered centre. Its coverage, box-filtered along that axis, is 1/2
+ t; the part above 1 spills into the uncovered neighbour, the part below is lost by the covered one. Outline
edges are enumerated from the mesh, not searched from the pixels, so triangles smaller than a pixel lose no
gradient.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.geometry.mesh import EdgeFaces
from lightprobe.kernels import gather_rows, values_at
from lightprobe.render.surface import View


@dataclass(frozen=True)
class Crossings:
    """Pairs of neighbouring pixels with the outline between them; K pairs."""

    inner: Tensor  # (K,) int64 flat index of the covered pixel
    outer: Tensor  # (K,) int64 flat index of the uncovered one
    gain: Tensor  # (K,) t - 1/2: coverage given to `outer` (> 0) or taken from `inner` (< 0); differentiable


def outline_vertices(screen: Tensor, faces: Tensor) -> Tensor:
    """Return (V,) bool, the vertices that an edge of the outline can have; `screen` (V, 3): projected.

    Front- and back-facing triangles meet there, or the triangles around do not close: then the sum over them of
    the vertex after it less the one before it is not zero.
    """
    f = faces.long()
    front = _facing(screen, faces)
    none = torch.zeros(len(screen), dtype=torch.bool, device=screen.device)
    ahead, back = (none.index_fill(0, f[side].reshape(-1), True) for side in (front, ~front))
    step = (f.roll(-1, 1) - f.roll(1, 1)).reshape(-1)
    sums = torch.zeros(len(screen), dtype=torch.long, device=screen.device).index_add_(0, f.reshape(-1), step)
    return (ahead & back) | (sums != 0)


def _facing(screen: Tensor, faces: Tensor) -> Tensor:
    """Return (F,) bool, whether a triangle looks at the camera."""
    corners = faces.T.long()
    x, y = (values_at(screen.detach()[:, axis].contiguous(), corners) for axis in (0, 1))
    return (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]) < 0


def _outline_edges(screen: Tensor, faces: Tensor, edges: EdgeFaces) -> Tensor:
    """Return (S, 2) vertex pairs of edges between a front- and a back-facing triangle, or on the mesh border."""
    front = _facing(screen, faces)
    one, two = edges.faces.unbind(1)
    ahead = (values_at(screen.detach()[:, 2].contiguous(), edges.vertices) > 1e-6).all(1)
    sides_differ = values_at(front, one) != values_at(front, two)
    return edges.vertices[(sides_differ | (one == two)) & ahead]


def _axis_crossings(ends: Tensor, covered: Tensor, along: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return inner, outer, t of the pairs along one image axis (0: left-right, 1: up-down); `ends` (S, 2, 2)."""
    height, width = covered.shape
    across = 1 - along
    fixed = ends.detach()[..., across]
    first = torch.ceil(fixed.amin(1) - 0.5)
    count = (torch.ceil(fixed.amax(1) - 0.5) - first).clamp(0, max(height, width)).long()
    edge = torch.repeat_interleave(torch.arange(len(ends), device=ends.device), count)
    start = torch.cumsum(count, 0) - count
    line = first[edge] + (torch.arange(len(edge), device=ends.device) - start[edge])
    p, q = gather_rows(ends.reshape(-1, 2), torch.stack([2 * edge, 2 * edge + 1], 1)).unbind(1)
    span = q[:, across] - p[:, across]
    place = p[:, along] + (line + 0.5 - p[:, across]) / span * (q[:, along] - p[:, along])
    low = torch.floor(place.detach() - 0.5)
    limit = (width, height)
    valid = (line >= 0) & (line < limit[across]) & (low >= 0) & (low < limit[along] - 1)
    place, low, line = place[valid], low[valid].long(), line[valid].long()
    step = 1 if along == 0 else width
    left = line * width + low if along == 0 else low * width + line
    flat = covered.reshape(-1)
    is_left, is_right = flat[left], flat[left + step]
    keep = is_left != is_right
    left, place, low, is_left = left[keep], place[keep], low[keep], is_left[keep]
    t = torch.where(is_left, place - low - 0.5, low + 1.5 - place)
    return torch.where(is_left, left, left + step), torch.where(is_left, left + step, left), t


def silhouette_crossings(
    screen: Tensor, faces: Tensor, edges: EdgeFaces, pixel: Tensor, view: View
) -> Crossings:
    """Return the outline's crossings; `screen` (V, 3): projected vertices, `pixel` (P,): covered ones.

    edges: of the whole mesh, or between `outline_vertices` alone.
    """
    covered = torch.zeros(view.height * view.width, dtype=torch.bool, device=screen.device)
    covered[pixel] = True
    covered = covered.reshape(view.height, view.width)
    pairs = _outline_edges(screen, faces, edges)
    ends = gather_rows(screen, pairs)[..., :2]
    extent = (ends.detach()[:, 0] - ends.detach()[:, 1]).abs()
    upright = extent[:, 1] >= extent[:, 0]
    parts = [_axis_crossings(ends[upright], covered, 0), _axis_crossings(ends[~upright], covered, 1)]
    inner, outer, t = (torch.cat(column) for column in zip(*parts, strict=True))
    # Thin features can cross one pair several times: the last crossing seen from inside is the visible
    # outline.
    order = torch.argsort(t.detach(), stable=True)
    order = order[torch.argsort((inner * (view.width * view.height) + outer)[order], stable=True)]
    inner, outer, t = inner[order], outer[order], t.index_select(0, order)
    last = torch.ones_like(inner, dtype=torch.bool)
    last[:-1] = (inner[1:] != inner[:-1]) | (outer[1:] != outer[:-1])
    return Crossings(inner[last], outer[last], t[last] - 0.5)


def coverage(pixel: Tensor, crossings: Crossings, count: int) -> Tensor:
    """Return the coverage (count,) in [0, 1] of all pixels; `pixel` (P,) are those the rasteriser covered."""
    base = torch.zeros(count, device=pixel.device, dtype=crossings.gain.dtype)
    base[pixel] = 1
    gain = crossings.gain
    taken = torch.index_add(base, 0, crossings.inner, gain.clamp(max=0))
    return torch.index_add(taken, 0, crossings.outer, gain.clamp(min=0)).clamp(0, 1)


def spread_color(radiance: Tensor, pixel: Tensor, crossings: Crossings, cover: Tensor) -> Tensor:
    """Return the premultiplied image (H * W, C) of `radiance` (P, C) at the covered pixels, outline included.

    An uncovered pixel on the outline shows the mean colour of its covered partners times its coverage.
    """
    count = cover.shape[0]
    row = torch.full((count,), -1, dtype=torch.long, device=pixel.device)
    row[pixel] = torch.arange(len(pixel), device=pixel.device)
    spill = crossings.gain > 0
    inner, outer = crossings.inner[spill], crossings.outer[spill]
    share = crossings.gain[spill].detach()
    image = torch.zeros(count, radiance.shape[1], device=radiance.device, dtype=radiance.dtype)
    image = image.index_copy(0, pixel, radiance)
    total = torch.zeros_like(cover).index_add(0, outer, share)
    part = share / total[outer].clamp(min=1e-12)
    image = image.index_add(0, outer, gather_rows(radiance, row[inner]) * part[:, None])
    return image * cover[:, None]

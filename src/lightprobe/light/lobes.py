"""Integrals of reflection lobes over the nodes of a cubemap's texel pyramid.

The prefiltered radiance of direction d at roughness r is the average of the light under the lobe

    D(h) max(n.l, 0),  with v = n = d, h the half vector, D = GGX of alpha = r^2.

With t the chord |l - d|: (n.h)^2 = cos^2(angle / 2) = 1 - t^2/4 and n.l = 1 - t^2/2, so the lobe depends on t alone:

    lobe(t) = (1 - t^2/2)+ / (alpha^2 + (1 - alpha^2) t^2/4)^2        (half width about 2 alpha; alpha = 1 is a cosine)

A lobe has a narrow core and a long tail. Each row therefore refers to a *pyramid* of area averages of the light
(2 x 2 texels per face, 4 x 4, ... R x R): fine nodes under the core, coarse ones in the tail, chosen so that averaging
the light over a node misplaces little of the row's weight. Under lobes narrower than a texel the refinement
goes on below the texel, which integrates the lobe exactly, and the parts are added up in that texel.
"""

import math

import scipy.sparse
import torch
from torch import Tensor

from lightprobe.light import cubemap

ROOT = 2  # texels along a face edge at the top of the pyramid
TOLERANCE = 5e-3  # share of a row's weight that one node may misplace by its own size
_CHUNK = 4096  # rows refined together: bounds the memory
_GAUSS = 1.0 / math.sqrt(3.0)


def pyramid_offsets(resolution: int) -> dict[int, int]:
    """Return the first row of each level in the stacked pyramid, by the level's resolution; key 0 is the total."""
    offsets, size, total = {}, ROOT, 0
    while size <= resolution:
        offsets[size] = total
        total += 6 * size * size
        size *= 2
    return {**offsets, 0: total}


def pyramid_matrix(resolution: int) -> scipy.sparse.csr_array:
    """Return the matrix (pyramid nodes, 6 R^2) of area averages; its last 6 R^2 rows are the texels themselves."""
    offsets = pyramid_offsets(resolution)
    solid_angle = cubemap.exact_solid_angles(resolution)
    face, row, column = torch.meshgrid(torch.arange(6), *[torch.arange(resolution)] * 2, indexing="ij")
    rows, weights = [], []
    for size, offset in offsets.items():
        if size == 0:
            continue
        ratio = resolution // size
        area = solid_angle.reshape(6, size, ratio, size, ratio).sum((2, 4))
        node = (face * size + row // ratio) * size + column // ratio
        rows.append((offset + node).flatten())
        weights.append((solid_angle / area.flatten()[node]).flatten())
    texel = torch.arange(6 * resolution**2).repeat(len(rows))
    entries = (torch.cat(weights).numpy(), (torch.cat(rows).numpy(), texel.numpy()))
    return scipy.sparse.csr_array(entries, shape=(offsets[0], 6 * resolution**2))


def lobe_matrix(
    directions: Tensor, alpha: float, resolution: int, tolerance: float = TOLERANCE
) -> scipy.sparse.csr_array:
    """Return the matrix (N, pyramid nodes) that averages a light of `resolution` under the lobe of each direction.

    directions: (N, 3) unit. Every row is non-negative and sums to 1.
    """
    parts = [
        _refine(directions[start : start + _CHUNK].double(), start, alpha, resolution, tolerance)
        for start in range(0, len(directions), _CHUNK)
    ]
    row, node, weight = (torch.cat(column).numpy() for column in zip(*parts, strict=True))
    shape = (len(directions), pyramid_offsets(resolution)[0])
    matrix = scipy.sparse.csr_array((weight, (row, node)), shape=shape)
    return scipy.sparse.csr_array(scipy.sparse.diags_array(1.0 / matrix.sum(axis=1)) @ matrix)


def _lobe(chord: Tensor, alpha: float) -> Tensor:
    """Return the lobe at a chord length, unnormalised."""
    quarter = 0.25 * chord * chord
    return (1.0 - 2.0 * quarter).clamp(min=0.0) / (alpha**2 + (1.0 - alpha**2) * quarter) ** 2


def _lobe_integral(alpha: float) -> float:
    """Return the integral of `_lobe` over the sphere: with q = t^2/4, dw = 4 pi dq and q runs from 0 to 1/2."""
    a2, k = alpha**2, 1.0 - alpha**2
    if k < 1e-4:
        return math.pi
    low, high = a2, a2 + 0.5 * k
    return 4.0 * math.pi / k * ((1.0 + 2.0 * a2 / k) * (1.0 / low - 1.0 / high) - 2.0 / k * math.log(high / low))


def _refine(
    directions: Tensor, first_row: int, alpha: float, resolution: int, tolerance: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Return (row, node, weight) of the rows of `directions`, refining the pyramid from its top."""
    offsets, total, width = pyramid_offsets(resolution), _lobe_integral(alpha), 2.0 * alpha
    size = ROOT
    node = torch.arange(6 * size * size).repeat(len(directions))
    row = torch.arange(len(directions)).repeat_interleave(6 * size * size)
    emitted = []
    while row.numel():
        face, y, x = node // (size * size), node // size % size, node % size
        point = cubemap.face_points(face, (2.0 * x.double() + 1.0) / size - 1.0, (2.0 * y.double() + 1.0) / size - 1.0)
        length = point.norm(dim=-1)
        area = 4.0 / size**2 / length**3
        extent = area.sqrt()
        chord = (point / length[:, None] - directions[row]).norm(dim=-1)
        near = (chord - 0.75 * extent).clamp(min=0.0)  # about the closest point of the node
        share = (area * _lobe(near, alpha) / total).clamp(max=1.0)
        split = share * extent > tolerance * torch.sqrt(width**2 + near**2)
        done = ~split & (share > 0.0)
        if done.any():
            weight = _node_weight(directions[row[done]], face[done], y[done], x[done], size, alpha)
            emitted.append((first_row + row[done], _stored(face[done], y[done], x[done], size, offsets), weight))
        row = row[split].repeat_interleave(4)
        face, y, x = (v[split, None] for v in (face, 2 * y, 2 * x))
        quad_y, quad_x = torch.tensor([0, 0, 1, 1]), torch.tensor([0, 1, 0, 1])
        node = ((face * 2 * size + y + quad_y) * 2 * size + x + quad_x).flatten()
        size *= 2
    rows, nodes, weights = (torch.cat(column) for column in zip(*emitted, strict=True))
    return rows, nodes, weights


def _node_weight(direction: Tensor, face: Tensor, y: Tensor, x: Tensor, size: int, alpha: float) -> Tensor:
    """Return the integral of the lobe over each node, by 2 x 2 Gauss points on the face plane."""
    weight = torch.zeros(len(face), dtype=torch.float64)
    for dy in (-_GAUSS, _GAUSS):
        for dx in (-_GAUSS, _GAUSS):
            point = cubemap.face_points(face, (2.0 * x + 1.0 + dx) / size - 1.0, (2.0 * y + 1.0 + dy) / size - 1.0)
            length = point.norm(dim=-1)
            weight += _lobe((point / length[:, None] - direction).norm(dim=-1), alpha) / length**3
    return weight / size**2


def _stored(face: Tensor, y: Tensor, x: Tensor, size: int, offsets: dict[int, int]) -> Tensor:
    """Return the stacked pyramid index of nodes; below the finest level, that of the texel that contains them."""
    finest = max(offsets)
    ratio = max(size // finest, 1)
    level = min(size, finest)
    return offsets[level] + (face * level + y // ratio) * level + x // ratio

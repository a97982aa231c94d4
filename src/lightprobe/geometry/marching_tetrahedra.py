"""Differentiable marching tetrahedra: signed distances on a lattice to triangles.

The surface crosses an edge whose ends have different signs at the zero of the linear interpolation, so vertex
positions are differentiable in the distances and in the lattice positions; the connectivity is not, and
changes only when a sign does. Inside is negative. Triangles are counter-clockwise seen from outside.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.geometry.tet_lattice import TET_EDGES, TetLattice
from lightprobe.kernels import gather_rows, values_at


def _case_table() -> Tensor:
    """Return (16, 2, 3) int64: up to two triangles of edge numbers for each sign pattern, -1 for none.

    Bit i of the pattern is set when corner i is inside. Orientation is settled on a reference tetrahedron.
    """
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
    middles = np.array([(corners[a] + corners[b]) / 2 for a, b in TET_EDGES])
    table = np.full((16, 2, 3), -1, np.int64)
    for code in range(1, 15):
        inside = [i for i in range(4) if code >> i & 1]
        outside = [i for i in range(4) if not code >> i & 1]
        edge = {frozenset(pair): number for number, pair in enumerate(TET_EDGES)}
        if len(inside) == 2:
            (a, b), (c, d) = inside, outside
            loop = [edge[frozenset(p)] for p in ((a, c), (a, d), (b, d), (b, c))]
        else:
            alone, others = (inside[0], outside) if len(inside) == 1 else (outside[0], inside)
            loop = [edge[frozenset((alone, other))] for other in others]
        outward = corners[outside].mean(0) - corners[inside].mean(0)
        p = middles[loop]
        if np.cross(p[1] - p[0], p[2] - p[0]) @ outward < 0:
            loop.reverse()
        for k in range(len(loop) - 2):
            table[code, k] = loop[0], loop[k + 1], loop[k + 2]
    return torch.from_numpy(table)


CASES = _case_table()


@dataclass(frozen=True)
class Crossing:
    """Where a surface crosses a lattice: what follows from the signs of its distances alone."""

    inside: Tensor  # (V,) bool
    tets: Tensor  # (A,) int64: tetrahedra the surface may pass; all others need no look
    edges: Tensor  # (N,) int64: the edges it crosses, ascending

    @staticmethod
    def of(lattice: TetLattice, distance: Tensor) -> "Crossing":
        """Return where the distances (V,) change sign."""
        inside = distance.detach() < 0
        tets = _mixed_tetrahedra(lattice, inside)
        named = torch.zeros(len(lattice.edges), dtype=torch.bool, device=inside.device)
        named.index_fill_(0, lattice.tet_edges.index_select(0, tets).reshape(-1), True)
        candidates = named.nonzero()[:, 0]
        low, high = lattice.edges.index_select(0, candidates).unbind(1)
        return Crossing(inside, tets, candidates[inside.index_select(0, low) != inside.index_select(0, high)])


def _mixed_tetrahedra(lattice: TetLattice, inside: Tensor) -> Tensor:
    """Return the tetrahedra (A,) int64 of the cells whose corners are neither all `inside` (V,) nor all outside.

    Looking at cells takes a third of looking at every tetrahedron.
    """
    flags = inside.to(torch.uint8)
    corners = torch.stack([flags.index_select(0, corner) for corner in lattice.cells])
    corners = corners.sum(0, dtype=torch.uint8)
    mixed = ((corners > 0) & (corners < len(lattice.cells))).nonzero()[:, 0]
    return (6 * mixed[:, None] + torch.arange(6, device=mixed.device)).reshape(-1)


def marching_tetrahedra(
    lattice: TetLattice, crossing: Crossing, positions: Tensor, distance: Tensor
) -> tuple[Tensor, Tensor]:
    """Return surface vertices (N, 3) float32 and faces (F, 3) int32.

    `positions` (V, 3) are the displaced lattice vertices, `distance` (V,) the signed distances (inside < 0)
    that `crossing` was found for. Gradients flow to both. N = 0 when the distances have one sign only.
    """
    number = torch.empty(len(lattice.edges), dtype=torch.long, device=distance.device)
    number[crossing.edges] = torch.arange(len(crossing.edges), device=distance.device)
    ends = lattice.edges.index_select(0, crossing.edges)
    p = gather_rows(positions, ends)  # (N, 2, 3)
    s = gather_rows(distance[:, None], ends)  # (N, 2, 1)
    vertices = (p[:, 0] * s[:, 1] - p[:, 1] * s[:, 0]) / (s[:, 1] - s[:, 0])

    bits = torch.tensor([1, 2, 4, 8], device=distance.device)
    corners = lattice.tets.index_select(0, crossing.tets)
    code = (values_at(crossing.inside, corners) * bits).sum(1)
    # (A, 2, 3) edge numbers within the tetrahedron
    triangles = CASES.to(distance.device).index_select(0, code)
    edges = lattice.tet_edges.index_select(0, crossing.tets)[:, None, :].expand(-1, 2, -1)
    faces = values_at(number, torch.gather(edges, 2, triangles.clamp(min=0)))
    real = (triangles[..., 0] >= 0).reshape(-1).nonzero()[:, 0]
    return vertices, faces.reshape(-1, 3).index_select(0, real).to(torch.int32)


def sign_change_loss(lattice: TetLattice, crossing: Crossing, distance: Tensor) -> Tensor:
    """Return the mean cross-entropy between the two ends of every crossed edge, a scalar.

    It pulls the distances (V,) of a crossed edge towards one common sign and so removes floaters and inner
    shells (Munkberg et al. 2022, section 3.1). Distances enter in units of a lattice cell.
    """
    pairs = lattice.edges.index_select(0, crossing.edges)
    ends = gather_rows(distance[:, None], pairs)[..., 0] / lattice.cell  # (N, 2)
    target = (ends.detach() > 0).to(ends.dtype).flip(1)
    return torch.nn.functional.binary_cross_entropy_with_logits(ends, target)

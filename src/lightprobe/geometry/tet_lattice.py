"""The tetrahedral lattice that carries the signed distance.

Every cell of a cubic grid is cut into the six tetrahedra that share its main diagonal (Kuhn's subdivision),
which match across cell faces. Only cells near or inside the start shape are kept, so that the cost follows
the object.

Notation: V lattice vertices, T tetrahedra, E edges; `cell` is the grid spacing in normalised units.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor


@dataclass(frozen=True)
class TetLattice:
    """Vertices and connectivity of the kept part of the lattice."""

    vertices: Tensor  # (V, 3) float32
    edges: Tensor  # (E, 2) int64, unique, lower index first
    cells: Tensor  # (8, C) int64: the corners x + 2y + 4z of each kept cell, whose tetrahedra stand together
    tets: Tensor  # (T, 4) int64, positively oriented; T = 6 C
    tet_edges: Tensor  # (T, 6) int64 into edges, in the order of TET_EDGES
    boundary: Tensor  # (V,) bool: on the outer border of the kept part, where the surface must not pass
    cell: float

    def to(self, device: torch.device) -> "TetLattice":
        """Return the lattice on another device."""
        parts = {name: part.to(device) for name, part in vars(self).items() if hasattr(part, "to")}
        return replace(self, **parts)


TET_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))  # as pairs of a tetrahedron's corners


def kuhn_tetrahedra() -> np.ndarray:
    """Return the unit cube's six tetrahedra as corners x + 2y + 4z, (6, 4) int64, positively oriented."""
    tets = []
    for order in itertools.permutations((1, 2, 4)):
        path = [0, order[0], order[0] + order[1], 7]
        corners = np.array([[c & 1, c >> 1 & 1, c >> 2 & 1] for c in path], np.float64)
        if np.linalg.det(corners[1:] - corners[0]) < 0:
            path[1], path[2] = path[2], path[1]
        tets.append(path)
    return np.array(tets, np.int64)


def build_lattice(keep: np.ndarray, lower: np.ndarray, cell: float) -> TetLattice:
    """Return the lattice of the cells in `keep` (N, N, N) bool, x first; cell (0,0,0) starts at `lower` (3,)."""
    cells = np.argwhere(keep)
    size = np.array(keep.shape) + 1
    strides = np.array([size[1] * size[2], size[2], 1])
    corners = np.array([[c & 1, c >> 1 & 1, c >> 2 & 1] for c in range(8)])
    corner_ids = (cells[:, None, :] + corners[None]) @ strides  # (C, 8)
    grid_ids, first = np.unique(corner_ids[:, kuhn_tetrahedra()].reshape(-1, 4), return_inverse=True)
    tets = first.reshape(-1, 4)
    coordinates = np.stack(np.unravel_index(grid_ids, size), axis=-1)
    pairs = np.sort(tets[:, np.array(TET_EDGES)].reshape(-1, 2), axis=1)
    keys, tet_edges = np.unique(pairs[:, 0] * len(grid_ids) + pairs[:, 1], return_inverse=True)
    edges = np.stack([keys // len(grid_ids), keys % len(grid_ids)], axis=-1)
    own_corners = np.searchsorted(grid_ids, corner_ids)
    used = np.bincount(own_corners.ravel(), minlength=len(grid_ids))
    return TetLattice(
        vertices=torch.from_numpy((coordinates * cell + lower).astype(np.float32)),
        edges=torch.from_numpy(edges),
        cells=torch.from_numpy(np.ascontiguousarray(own_corners.T)),
        tets=torch.from_numpy(tets),
        tet_edges=torch.from_numpy(tet_edges.reshape(-1, 6)),
        boundary=torch.from_numpy(used < 8),  # an inner vertex belongs to eight kept cells
        cell=float(cell),
    )

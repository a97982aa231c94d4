"""Stacking of probe pixels onto a cubemap, through the tiles of its faces where that is faster.

Each face is cut into 4 x 4 tiles, the roots, and each tile into quarters, row by row, down to 4 x 4 texels;
what a pixel does in this tree, and how far its sums may be off, stands in `kernels.culled_stacking`.
"""

import functools
import math

import numpy as np
import torch
from torch import Tensor

from lightprobe.kernels import stack_probes, stack_probes_culled
from lightprobe.kernels.culled_stacking import NODES, SIDE, TileTree
from lightprobe.light import cubemap

LEAST_RESOLUTION = 64  # below, all pairs take no longer
ROOTS = 4  # tiles along each edge of a face at the top


@torch.no_grad()
def stack_on_cubemap(
    colors: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, resolution: int
) -> tuple[Tensor, Tensor]:
    """Return radiance P (6, R, R, 3) and weight W (6, R, R) of `kernels.stack_probes` in all texels.

    colors, normals, views (N, 3), alpha2 (N,) in (0, 1]. Within the bound of `kernels.culled_stacking` for
    float32 on the CPU and R a power of two from `LEAST_RESOLUTION`; exact elsewhere, and on a GPU, which does
    not mind the pairs. Faster when neighbouring pixels are alike. The bits do not depend on the number of
    threads. Not differentiable.
    """
    shape = (6, resolution, resolution)
    if _pays(colors, resolution):
        radiance, weight = stack_probes_culled(colors, normals, views, alpha2, tile_tree(resolution))
    else:
        directions = cubemap.exact_directions(resolution, colors.device).to(colors.dtype).reshape(-1, 3)
        radiance, weight = stack_probes(colors, normals, views, alpha2, directions)
    return radiance.reshape(*shape, 3), weight.reshape(shape)


def _pays(colors: Tensor, resolution: int) -> bool:
    fits = resolution >= LEAST_RESOLUTION and resolution & (resolution - 1) == 0
    return fits and colors.device.type == "cpu" and colors.dtype == torch.float32


@functools.lru_cache(maxsize=4)
def tile_tree(resolution: int) -> TileTree:
    """Return the 96 roots of a cubemap, R a power of two from 32, and all their tiles, row by row."""
    nodes = -np.cos((2 * np.arange(SIDE) + 1) * math.pi / (2 * SIDE))
    texels = (2 * np.arange(SIDE) + 1) / SIDE - 1
    last = int(math.log2(resolution // (ROOTS * SIDE)))
    levels = [_level(level, texels if level == last else nodes) for level in range(last + 1)]
    tiles, bounds = (np.concatenate(parts, axis=1).astype(np.float32) for parts in zip(*levels, strict=True))
    maps = np.stack([_interpolation(nodes, nodes), _interpolation(nodes, texels)])
    return TileTree(tiles, bounds, maps, _texels(last, resolution))


def _level(level: int, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `tiles` and `bounds` of one level, with nodes or texels at `offsets` (4,) in [-1, 1]."""
    centres, corners = _directions(level, np.zeros(1)), _directions(level, np.array([-1.0, 1.0]))
    radii = np.linalg.norm(corners - centres, axis=3).max(axis=2, keepdims=True)
    positions = _directions(level, offsets).swapaxes(2, 3).reshape(*radii.shape[:2], 3 * NODES)
    bounds = np.concatenate([centres[:, :, 0], radii], axis=2)
    return np.pad(positions, [(0, 0), (0, 0), (0, 4 * NODES)]), bounds


def _places(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column (4^level,) in their root of the tiles of one level, quarter by quarter."""
    row: np.ndarray = np.zeros(1, np.int64)
    column = row
    for _ in range(level):
        row = (2 * row[:, None] + [0, 0, 1, 1]).ravel()
        column = (2 * column[:, None] + [0, 1, 0, 1]).ravel()
    return row, column


def _texels(last: int, resolution: int) -> np.ndarray:
    face, top, left = (part.reshape(-1, 1, 1, 1) for part in np.indices((6, ROOTS, ROOTS)))
    row, column = (place[:, None, None] for place in _places(last))
    y = (top * 2**last + row) * SIDE + np.arange(SIDE)[:, None]
    x = (left * 2**last + column) * SIDE + np.arange(SIDE)
    return ((face * resolution + y) * resolution + x).reshape(6 * ROOTS**2, -1, NODES)


def _directions(level: int, offsets: np.ndarray) -> np.ndarray:
    """Return unit directions (96, 4^level, n n, 3) float64 at `offsets` (n,) in [-1, 1] of a level's tiles"""
    face, top, left = (part.reshape(-1, 1, 1, 1) for part in np.indices((6, ROOTS, ROOTS)))
    row, column = (place[:, None, None] for place in _places(level))
    half = 1 / ROOTS / 2**level
    down = -1 + 2 * top / ROOTS + half * (2 * row + 1 + offsets[:, None])
    along = -1 + 2 * left / ROOTS + half * (2 * column + 1 + offsets)
    grid = (torch.from_numpy(part.copy()) for part in np.broadcast_arrays(face, along, down))
    points = torch.nn.functional.normalize(cubemap.face_points(*grid), dim=-1)
    return points.numpy().reshape(len(top), row.shape[0], -1, 3)


def _interpolation(nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return (4, 16, 16): from a tile's nodes (second) to `points` of each of its quarters (third)."""
    halves = []
    for shift in (-1, 1):
        at = (points + shift) / 2
        rows = range(SIDE)
        factors = [[(at - nodes[m]) / (nodes[i] - nodes[m]) for m in rows if m != i] for i in rows]
        halves.append(np.prod(np.array(factors), axis=1))  # (node, point)
    quarters = [np.kron(halves[row], halves[column]) for row in range(2) for column in range(2)]
    return np.stack(quarters).astype(np.float32)

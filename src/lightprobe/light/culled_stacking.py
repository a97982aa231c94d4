"""Stacking of probe pixels onto a whole cubemap without visiting every (pixel, texel) pair.

A lobe is sharp near its peak and its horizon and smooth everywhere else. So each face is cut into 4 x 4 tiles and each
tile into quarters, down to 4 x 4 texels, and a pixel goes down this tree only where its lobe demands it:

    tile below the pixel's horizon        nothing
    lobe smooth over the tile             its values at 4 x 4 Chebyshev nodes are added to the tile's sums
    the quarters are the last             its values at all their texels are added, exact
    else                                  on to the four quarters

When all pixels are in, every tile hands its sums down by cubic interpolation, to the nodes of its quarters and in the
end to texels. Interpolation is linear, so it is done once for all pixels, and both sums of Equation 5 go the same way.

**Error.** With the components k, s of the half vector (`kernels.lobe_frames`) the only singularities of the lobe, as a
function of a complex position, lie where k + a2 s^2 = 0. Both terms are squares of lengths that change no faster than w
does, so the nearest is at least d = sqrt(k + a2 s^2) away. The lobe counts as smooth over a tile of radius q if
d >= `SEPARATION` q. Interpolation at n Chebyshev nodes in an interval of half length q / sqrt 2 converges as rho^-n,
where rho, the sum of the half axes of the ellipse through the singularity, is 8.4 here, and n = 4. This error is
relative to the lobe's own size on the tile, so it holds for every mixture of lobes, and also in directions that are
hardly seen. W and P are within `ERROR` of the exact sums in relative L2; the worst seen, among few pixels chosen to
provoke it, is .6 of that.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
import torch
from numba import prange
from torch import Tensor

from lightprobe.core.jit import arrays, compiled, threads
from lightprobe.kernels import stack_probes
from lightprobe.kernels.lobe_frames import lobe_frames
from lightprobe.kernels.numba.stacking import FUSED, ZERO, components, lobe, pixel_frame
from lightprobe.kernels.stacking import LEAST_ALPHA2
from lightprobe.light import cubemap

ERROR = 1e-3  # relative L2
SEPARATION = 3.0  # least distance of a lobe's singularity, in radii of the tile
LEAST_RESOLUTION = 64  # below, all pairs take no longer
ROOTS = 4  # tiles along each edge of a face at the top
SIDE = 4  # nodes, or texels at the bottom, along each edge of a tile
NODES = SIDE * SIDE
HONEST = FUSED - {"nnan", "ninf"}  # comparisons with NaN are false, so that a broken pixel goes down to all texels
_STEPS_PER_PIXEL = 20_000  # nanoseconds or so, with all roots


@torch.no_grad()
def stack_on_cubemap(
    colors: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, resolution: int
) -> tuple[Tensor, Tensor]:
    """Return radiance P (6, R, R, 3) and weight W (6, R, R) of `kernels.stack_probes` in all texels of a cubemap.

    colors, normals, views (N, 3), alpha2 (N,) in (0, 1]. Within `ERROR` of the exact sums for float32 on the CPU and
    R a power of two from `LEAST_RESOLUTION`; exact elsewhere, and on a GPU, which does not mind the pairs. Faster when
    neighbouring pixels are alike. The bits do not depend on the number of threads. Not differentiable.
    """
    shape = (6, resolution, resolution)
    if not _pays(colors, resolution):
        directions = cubemap.exact_directions(resolution, colors.device).to(colors.dtype).reshape(-1, 3)
        radiance, weight = stack_probes(colors, normals, views, alpha2, directions)
        return radiance.reshape(*shape, 3), weight.reshape(shape)
    alpha2 = alpha2.clamp(min=LEAST_ALPHA2)
    scale = alpha2[:, None] / math.pi
    factors = torch.cat([scale, scale * colors], dim=1)
    tree = _tree(resolution)
    weight, radiance = colors.new_empty(6 * resolution**2), colors.new_empty(6 * resolution**2, 3)
    threads(len(colors) * _STEPS_PER_PIXEL)
    _stack(
        *arrays(lobe_frames(normals, views, alpha2), factors), tree.bounds, tree.maps, tree.texels, tree.tiles.copy(),
        weight.numpy(), radiance.numpy(),
    )  # fmt: skip
    return radiance.reshape(*shape, 3), weight.reshape(shape)


def _pays(colors: Tensor, resolution: int) -> bool:
    fits = resolution >= LEAST_RESOLUTION and resolution & (resolution - 1) == 0
    return fits and colors.device.type == "cpu" and colors.dtype == torch.float32


@dataclass(frozen=True)
class _Tree:
    """The tiles of a cubemap: 96 roots of T tiles each; tile i has the quarters 4 i + 1 .. 4 i + 4, row by row."""

    tiles: np.ndarray  # (96, T, 7 * 16) float32: x, y, z of the nodes or texels, then zeros for W and the three sums
    bounds: np.ndarray  # (96, T, 4) float32: centre, and the largest distance from it
    maps: np.ndarray  # (2, 4, 16, 16) float32: from a tile's nodes (third) to those of each quarter, or to its texels
    texels: np.ndarray  # (96, leaves, 16) int64: flat index of the texels of the last quarters


@functools.lru_cache(maxsize=4)
def _tree(resolution: int) -> _Tree:
    nodes = -np.cos((2 * np.arange(SIDE) + 1) * math.pi / (2 * SIDE))
    texels = (2 * np.arange(SIDE) + 1) / SIDE - 1
    last = int(math.log2(resolution // (ROOTS * SIDE)))
    levels = [_level(level, texels if level == last else nodes) for level in range(last + 1)]
    tiles, bounds = (np.concatenate(parts, axis=1).astype(np.float32) for parts in zip(*levels, strict=True))
    maps = np.stack([_interpolation(nodes, nodes), _interpolation(nodes, texels)])
    return _Tree(tiles, bounds, maps, _texels(last, resolution))


def _level(level: int, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `tiles` and `bounds` of one level, with nodes or texels at `offsets` (4,) in [-1, 1]."""
    centres = _directions(level, np.zeros(1))
    radii = np.linalg.norm(_directions(level, np.array([-1.0, 1.0])) - centres, axis=3).max(axis=2, keepdims=True)
    positions = _directions(level, offsets).swapaxes(2, 3).reshape(*radii.shape[:2], 3 * NODES)
    return np.pad(positions, [(0, 0), (0, 0), (0, 4 * NODES)]), np.concatenate([centres[:, :, 0], radii], axis=2)


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
    """Return unit directions (96, 4^level, n n, 3) float64 at `offsets` (n,) in [-1, 1] of the tiles of one level."""
    face, top, left = (part.reshape(-1, 1, 1, 1) for part in np.indices((6, ROOTS, ROOTS)))
    row, column = (place[:, None, None] for place in _places(level))
    half = 1 / ROOTS / 2**level
    down = -1 + 2 * top / ROOTS + half * (2 * row + 1 + offsets[:, None])
    along = -1 + 2 * left / ROOTS + half * (2 * column + 1 + offsets)
    grid = (torch.from_numpy(part.copy()) for part in np.broadcast_arrays(face, along, down))
    points = torch.nn.functional.normalize(cubemap.face_points(*grid), dim=-1)
    return points.numpy().reshape(len(top), row.shape[0], -1, 3)


def _interpolation(nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return (4, 16, 16): from values at a tile's nodes (second) to those at `points` of each quarter (third)."""
    halves = []
    for shift in (-1, 1):
        at = (points + shift) / 2
        factors = [[(at - nodes[m]) / (nodes[i] - nodes[m]) for m in range(SIDE) if m != i] for i in range(SIDE)]
        halves.append(np.prod(np.array(factors), axis=1))  # (node, point)
    quarters = [np.kron(halves[row], halves[column]) for row in range(2) for column in range(2)]
    return np.stack(quarters).astype(np.float32)


@compiled(parallel=True, fastmath=HONEST)
def _stack(frame, factors, bounds, maps, texels, tiles, weight, radiance):
    for root in prange(tiles.shape[0]):
        todo = np.empty(64, np.int32)
        for p in range(frame.shape[0]):
            weights = factors[p, 0], factors[p, 1], factors[p, 2], factors[p, 3]
            _descend(pixel_frame(frame, p), weights, bounds[root], tiles[root], todo)
        _hand_down(maps, tiles[root])
        _write(tiles[root], texels[root], weight, radiance)


@compiled(fastmath=HONEST, inline="always")
def _descend(frame, weights, bounds, tiles, todo):
    """Add one pixel to the tiles of one root; `todo` is room for the tiles yet to be looked at."""
    first_leaf = bounds.shape[0] // 4
    todo[0], waiting = 0, 1
    while waiting > 0:
        waiting -= 1
        tile = todo[waiting]
        k, s, cosine = components(frame, bounds[tile, 0], bounds[tile, 1], bounds[tile, 2])
        radius = bounds[tile, 3]
        if cosine + radius <= 0:
            continue
        separation = np.float32(SEPARATION) * radius
        if cosine >= radius and separation * separation <= k + frame[12] * s * s:
            _add(frame, weights, tiles[tile])
        elif 4 * tile + 1 >= first_leaf:
            for quarter in range(4):
                _add(frame, weights, tiles[4 * tile + 1 + quarter])
        else:
            for quarter in range(4):
                todo[waiting + quarter] = 4 * tile + 1 + quarter
            waiting += 4


@compiled(fastmath=FUSED, inline="always")
def _add(frame, weights, tile):
    """Add a pixel at the nodes of a tile (112,); as one row, so that its parts are known not to overlap."""
    one, red, green, blue = weights
    for j in range(NODES):
        value = lobe(frame, tile[j], tile[NODES + j], tile[2 * NODES + j])
        tile[3 * NODES + j] += one * value
        tile[4 * NODES + j] += red * value
        tile[5 * NODES + j] += green * value
        tile[6 * NODES + j] += blue * value


@compiled(fastmath=FUSED)
def _hand_down(maps, tiles):
    """Add the sums of every tile to its quarters, the largest tiles first."""
    first_leaf = tiles.shape[0] // 4
    sums = np.empty(NODES, np.float32)
    for tile in range(first_leaf):
        for quarter in range(4):
            child = 4 * tile + 1 + quarter
            matrix = maps[1 if child >= first_leaf else 0, quarter]
            for channel in range(3, 7):
                sums[:] = ZERO
                for i in range(NODES):
                    value = tiles[tile, channel * NODES + i]
                    for j in range(NODES):
                        sums[j] += value * matrix[i, j]
                for j in range(NODES):
                    tiles[child, channel * NODES + j] += sums[j]


@compiled(fastmath=FUSED)
def _write(tiles, texels, weight, radiance):
    """Write the sums of the last tiles to their texels, those of the colours divided by W."""
    first_leaf = tiles.shape[0] // 4
    for leaf in range(texels.shape[0]):
        for j in range(NODES):
            texel, total = texels[leaf, j], tiles[first_leaf + leaf, 3 * NODES + j]
            weight[texel] = total
            for channel in range(3):
                share = tiles[first_leaf + leaf, (4 + channel) * NODES + j]
                radiance[texel, channel] = ZERO if total == ZERO else share / total

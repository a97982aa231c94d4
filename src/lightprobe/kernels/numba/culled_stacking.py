"""Numba loops of the culled stacking; symbols as in `lightprobe.kernels.culled_stacking`.

A thread takes a root of the tree with all its tiles, so no two write to the same place.
"""

import numpy as np
from numba import prange

from lightprobe.core.jit import compiled
from lightprobe.kernels.culled_stacking import NODES, SEPARATION
from lightprobe.kernels.numba.stacking import FUSED, ZERO, components, lobe, pixel_frame

HONEST = FUSED - {"nnan", "ninf"}  # comparisons with NaN are false: a broken pixel goes down to all texels


@compiled(parallel=True, fastmath=HONEST)
def stack(frame, factors, bounds, maps, texels, tiles, weight, radiance):
    """Fill weight (M,) and radiance (M, 3) from frames (N, 13) and factors (N, 4); `tiles` is overwritten."""
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
    """Write the sums of the last tiles to their texels, with colours divided by W."""
    first_leaf = tiles.shape[0] // 4
    for leaf in range(texels.shape[0]):
        for j in range(NODES):
            texel, total = texels[leaf, j], tiles[first_leaf + leaf, 3 * NODES + j]
            weight[texel] = total
            for channel in range(3):
                share = tiles[first_leaf + leaf, (4 + channel) * NODES + j]
                radiance[texel, channel] = ZERO if total == ZERO else share / total

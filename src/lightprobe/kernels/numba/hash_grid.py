"""Numba backend of the hash grid; symbols as in `lightprobe.kernels.hash_grid`.

Forward goes level by level, so that one level's table stays in the cache, with the points shared among
threads. Backward to the table shares out the levels: no two threads add to one table, and each sum runs in
the order of the points. Backward to the points shares out the points.
"""

import numpy as np
import torch
from numba import prange
from torch import Tensor

from lightprobe.core.jit import arrays, compiled, threads

PRIME_Y = np.uint32(2654435761)
PRIME_Z = np.uint32(805459861)


def encode(points: Tensor, table: Tensor, cells: list[int]) -> Tensor:
    """Return the features (N, L*F)."""
    out = table.new_empty(points.shape[0], table.shape[0] * table.shape[2])
    _encode(*arrays(points, table), np.array(cells, np.int32), threads(8 * out.numel()), out.numpy())
    return out


def encode_backward(grad: Tensor, points: Tensor, cells: list[int], table_shape: torch.Size) -> Tensor:
    """Return the gradient (L, T, F) to the table."""
    out = grad.new_zeros(table_shape)
    _encode_backward(*arrays(grad, points), np.array(cells, np.int32), threads(8 * grad.numel()), out.numpy())
    return out


def encode_backward_to_points(grad: Tensor, points: Tensor, table: Tensor, cells: list[int]) -> Tensor:
    """Return the gradient (N, 3) to the points."""
    out = torch.zeros_like(points)
    work = threads(8 * grad.numel())
    _encode_backward_to_points(*arrays(grad, points, table), np.array(cells, np.int32), work, out.numpy())
    return out


@compiled()
def _cell(points, n, resolution):
    """Return the cell of a point and its position in the cell, per axis; NaN in the first cell, at NaN."""
    scale = np.float32(resolution)
    x = min(max(points[n, 0], np.float32(0)), np.float32(1)) * scale
    y = min(max(points[n, 1], np.float32(0)), np.float32(1)) * scale
    z = min(max(points[n, 2], np.float32(0)), np.float32(1)) * scale
    last = resolution - 1
    i, j, k = max(min(int(x), last), 0), max(min(int(y), last), 0), max(min(int(z), last), 0)
    return i, j, k, x - np.float32(i), y - np.float32(j), z - np.float32(k)


@compiled()
def _row(i, j, k, side, mask, dense):
    """Return the table row of a lattice corner."""
    if dense:
        return i + side * (j + side * k)
    return np.int64((np.uint32(i) ^ (np.uint32(j) * PRIME_Y) ^ (np.uint32(k) * PRIME_Z)) & mask)


@compiled(parallel=True)
def _encode(points, table, cells, workers, out):
    share = (points.shape[0] + workers - 1) // workers
    for worker in prange(workers):
        for level in range(table.shape[0]):
            begin, end = worker * share, min(points.shape[0], (worker + 1) * share)
            _encode_level(points, table, cells, level, begin, end, out)


@compiled()
def _encode_level(points, table, cells, level, begin, end, out):
    features = table.shape[2]
    resolution = np.int64(cells[level])
    side, mask = resolution + 1, np.uint32(table.shape[1] - 1)
    dense = side * side * side <= table.shape[1]
    for n in range(begin, end):
        i, j, k, x, y, z = _cell(points, n, resolution)
        for f in range(features):
            out[n, level * features + f] = 0.0
        for corner in range(8):
            a, b, c = corner & 1, (corner >> 1) & 1, corner >> 2
            row = _row(i + a, j + b, k + c, side, mask, dense)
            weight = (x if a else 1 - x) * (y if b else 1 - y) * (z if c else 1 - z)
            for f in range(features):
                out[n, level * features + f] += weight * table[level, row, f]


@compiled(parallel=True)
def _encode_backward(grad, points, cells, workers, out):
    for worker in prange(workers):
        for level in range(worker, out.shape[0], workers):
            _encode_level_backward(grad, points, cells, level, out)


@compiled()
def _encode_level_backward(grad, points, cells, level, out):
    features = out.shape[2]
    resolution = np.int64(cells[level])
    side, mask = resolution + 1, np.uint32(out.shape[1] - 1)
    dense = side * side * side <= out.shape[1]
    for n in range(points.shape[0]):
        i, j, k, x, y, z = _cell(points, n, resolution)
        for corner in range(8):
            a, b, c = corner & 1, (corner >> 1) & 1, corner >> 2
            row = _row(i + a, j + b, k + c, side, mask, dense)
            weight = (x if a else 1 - x) * (y if b else 1 - y) * (z if c else 1 - z)
            for f in range(features):
                out[level, row, f] += weight * grad[n, level * features + f]


@compiled(parallel=True)
def _encode_backward_to_points(grad, points, table, cells, workers, out):
    share = (points.shape[0] + workers - 1) // workers
    for worker in prange(workers):
        for level in range(table.shape[0]):
            begin, end = worker * share, min(points.shape[0], (worker + 1) * share)
            _encode_level_backward_to_points(grad, points, table, cells, level, begin, end, out)


@compiled()
def _encode_level_backward_to_points(grad, points, table, cells, level, begin, end, out):
    features = table.shape[2]
    resolution = np.int64(cells[level])
    scale = np.float32(resolution)
    side, mask = resolution + 1, np.uint32(table.shape[1] - 1)
    dense = side * side * side <= table.shape[1]
    for n in range(begin, end):
        i, j, k, x, y, z = _cell(points, n, resolution)
        along_x, along_y, along_z = np.float32(0), np.float32(0), np.float32(0)
        for corner in range(8):
            a, b, c = corner & 1, (corner >> 1) & 1, corner >> 2
            row = _row(i + a, j + b, k + c, side, mask, dense)
            value = np.float32(0)
            for f in range(features):
                value += grad[n, level * features + f] * table[level, row, f]
            weight_x, weight_y, weight_z = x if a else 1 - x, y if b else 1 - y, z if c else 1 - z
            along_x += (value if a else -value) * weight_y * weight_z
            along_y += (value if b else -value) * weight_x * weight_z
            along_z += (value if c else -value) * weight_x * weight_y
        if 0 <= points[n, 0] <= 1:
            out[n, 0] += scale * along_x
        if 0 <= points[n, 1] <= 1:
            out[n, 1] += scale * along_y
        if 0 <= points[n, 2] <= 1:
            out[n, 2] += scale * along_z

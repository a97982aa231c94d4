"""Numba loops of the sparse products; symbols as in `lightprobe.kernels.sparse`; float32 and float64."""

import numpy as np
import torch
from numba import prange
from torch import Tensor

from lightprobe.core.jit import compiled, threads
from lightprobe.kernels.sparse import CompressedRows


def product(matrix: CompressedRows, x: Tensor, rows: Tensor | None) -> Tensor:
    """Return the product (K, 3) of the rows (K,), all (M,) if None."""
    count = matrix.start.numel() - 1
    chosen = np.arange(count, dtype=np.int32) if rows is None else rows.numpy()
    out = torch.empty((len(chosen), 3), dtype=x.dtype)
    threads(len(chosen) * 2 * matrix.value.numel() // (count + 1))
    _multiply(*_stored(matrix), chosen, x.contiguous().numpy(), out.numpy())
    return out


def product_transposed(matrix: CompressedRows, y: Tensor, rows: Tensor, bounds: np.ndarray) -> Tensor:
    """Return the transposed product (N, 3) on y (K, 3)."""
    parts = torch.zeros((len(bounds) - 1, matrix.columns, 4), dtype=y.dtype)
    threads(len(rows) * 4 * matrix.value.numel() // matrix.start.numel())
    _spread(*_stored(matrix), rows.numpy(), bounds, y.contiguous().numpy(), parts.numpy())
    return parts.sum(0)[:, :3]


def _stored(matrix: CompressedRows) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return matrix.start.numpy(), matrix.column.numpy(), matrix.value.numpy()


@compiled(fastmath={"contract"}, inline="always")
def _entry(column, value, padded, k):
    """Return the value of entry k and the row of x that it is multiplied by."""
    j = column[k]
    return value[k], padded[j, 0], padded[j, 1], padded[j, 2], padded[j, 3]


@compiled(parallel=True, fastmath={"contract"})
def _multiply(start, column, value, rows, x, out):
    """Rows of x are padded to four, so that one vector holds one; four sums at a time hide the adds' latency."""
    padded = np.zeros((x.shape[0], 4), out.dtype)
    padded[:, :3] = x
    for q in prange(rows.size):
        a0 = a1 = a2 = a3 = b0 = b1 = b2 = b3 = out.dtype.type(0)
        c0 = c1 = c2 = c3 = d0 = d1 = d2 = d3 = out.dtype.type(0)
        first, end = start[rows[q]], start[rows[q] + 1]
        whole = first + (end - first) // 4 * 4
        for k in range(first, whole, 4):
            w, x0, x1, x2, x3 = _entry(column, value, padded, k)
            a0, a1, a2, a3 = a0 + w * x0, a1 + w * x1, a2 + w * x2, a3 + w * x3
            w, x0, x1, x2, x3 = _entry(column, value, padded, k + 1)
            b0, b1, b2, b3 = b0 + w * x0, b1 + w * x1, b2 + w * x2, b3 + w * x3
            w, x0, x1, x2, x3 = _entry(column, value, padded, k + 2)
            c0, c1, c2, c3 = c0 + w * x0, c1 + w * x1, c2 + w * x2, c3 + w * x3
            w, x0, x1, x2, x3 = _entry(column, value, padded, k + 3)
            d0, d1, d2, d3 = d0 + w * x0, d1 + w * x1, d2 + w * x2, d3 + w * x3
        for k in range(whole, end):
            w, x0, x1, x2, x3 = _entry(column, value, padded, k)
            a0, a1, a2, a3 = a0 + w * x0, a1 + w * x1, a2 + w * x2, a3 + w * x3
        out[q, 0], out[q, 1], out[q, 2] = a0 + b0 + c0 + d0, a1 + b1 + c1 + d1, a2 + b2 + c2 + d2


@compiled(parallel=True, fastmath={"contract"})
def _spread(start, column, value, rows, bounds, y, parts):
    """Add the transposed product of the rows[bounds[c] : bounds[c + 1]] to parts[c] (columns, 4), for each c."""
    for c in prange(parts.shape[0]):
        part = parts[c]
        for q in range(bounds[c], bounds[c + 1]):
            y0, y1, y2, y3 = y[q, 0], y[q, 1], y[q, 2], parts.dtype.type(0)
            for k in range(start[rows[q]], start[rows[q] + 1]):
                j, w = column[k], value[k]
                part[j, 0] += w * y0
                part[j, 1] += w * y1
                part[j, 2] += w * y2
                part[j, 3] += w * y3


@compiled(parallel=True)
def permute(start, column, value, which, by, source, new_start, new_column, new_value):
    """Write the new rows, which start at `new_start` (T + 1,)."""
    for row in prange(len(which)):
        nodes, at = source[by[row]], new_start[row]
        for k in range(start[which[row]], start[which[row] + 1]):
            new_column[at], new_value[at] = nodes[column[k]], value[k]
            at += 1

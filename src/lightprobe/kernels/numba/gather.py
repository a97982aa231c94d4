"""Numba body of the row gathers; symbols as in `lightprobe.kernels.gather`.

The scatters give each thread its own destination rows and let it read the whole index. So no two threads write one row,
and a row's sum runs in index order for any number of threads. Rows are dealt in runs of 64: neighbours are often hot
together, and a run is longer than a cache line.
"""

import numpy as np
import torch
from numba import prange
from torch import Tensor

from lightprobe.kernels.numba.jit import arrays, compiled, threads

RUN_BITS = 6


def weighted_gather(values: Tensor, index: Tensor, weight: Tensor) -> Tensor:
    """Return (N, C): sum over k of `weight[n, k] * values[index[n, k]]`."""
    out = values.new_empty(index.shape[0], values.shape[1])
    threads(index.numel() * values.shape[1])
    _gather(*arrays(values, index, weight), out.numpy())
    return out


def scatter_weighted(grad: Tensor, index: Tensor, weight: Tensor, rows: int) -> Tensor:
    """Return the gradient (rows, C) to `values`."""
    out = grad.new_zeros(rows, grad.shape[1])
    _scatter_weighted(*arrays(grad, index, weight), _lanes(index.numel() * grad.shape[1]), out.numpy())
    return out


def row_products(grad: Tensor, index: Tensor, values: Tensor) -> Tensor:
    """Return the gradient (N, K) to `weight`."""
    out = torch.empty(index.shape, dtype=grad.dtype)
    threads(index.numel() * values.shape[1])
    _row_products(*arrays(grad, index, values), out.numpy())
    return out


def scatter_rows(grad: Tensor, index: Tensor, rows: int) -> Tensor:
    """Return (rows, C): `grad` (N, C) summed into the rows named by `index` (N,)."""
    out = grad.new_zeros(rows, grad.shape[1])
    _scatter_rows(*arrays(grad, index), _lanes(grad.numel()), out.numpy())
    return out


def _lanes(work: int) -> int:
    """Return the largest power of two not above the number of threads for this work."""
    return 1 << (threads(work).bit_length() - 1)


@compiled(parallel=True)
def _gather(values, index, weight, out):
    for n in prange(index.shape[0]):
        for c in range(values.shape[1]):
            out[n, c] = 0.0
        for k in range(index.shape[1]):
            row, factor = index[n, k], weight[n, k]
            for c in range(values.shape[1]):
                out[n, c] += factor * values[row, c]


@compiled(parallel=True)
def _scatter_weighted(grad, index, weight, lanes, out):
    for lane in prange(lanes):
        for n in range(index.shape[0]):
            for k in range(index.shape[1]):
                row = index[n, k]
                if (row >> RUN_BITS) & (lanes - 1) == lane:
                    for c in range(grad.shape[1]):
                        out[row, c] += weight[n, k] * grad[n, c]


@compiled(parallel=True, fastmath={"contract", "reassoc"})
def _row_products(grad, index, values, out):
    for n in prange(index.shape[0]):
        for k in range(index.shape[1]):
            row, total = index[n, k], np.float32(0.0)
            for c in range(grad.shape[1]):
                total += grad[n, c] * values[row, c]
            out[n, k] = total


@compiled(parallel=True)
def _scatter_rows(grad, index, lanes, out):
    for lane in prange(lanes):
        for n in range(index.shape[0]):
            row = index[n]
            if (row >> RUN_BITS) & (lanes - 1) == lane:
                for c in range(grad.shape[1]):
                    out[row, c] += grad[n, c]

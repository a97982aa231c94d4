"""Numba backend of the row gathers; symbols as in `lightprobe.kernels.gather`.

The scatters run on one thread, in index order: that is limited by memory, repeatable without care, and
measured faster than dealing the rows out to two threads, which each have to read the whole index and skip
half of it unpredictably.
"""

import numpy as np
import torch
from numba import prange
from torch import Tensor

from lightprobe.core.jit import arrays, compiled, threads


def weighted_gather(values: Tensor, index: Tensor, weight: Tensor) -> Tensor:
    """Return (N, C): sum over k of `weight[n, k] * values[index[n, k]]`."""
    out = values.new_empty(index.shape[0], values.shape[1])
    threads(index.numel() * values.shape[1])
    _gather(*arrays(values, index, weight), out.numpy())
    return out


def scatter_weighted(grad: Tensor, index: Tensor, weight: Tensor, rows: int) -> Tensor:
    """Return the gradient (rows, C) to `values`."""
    out = grad.new_zeros(rows, grad.shape[1])
    _scatter_weighted(*arrays(grad, index, weight), out.numpy())
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
    _scatter_rows(*arrays(grad, index), out.numpy())
    return out


@compiled(parallel=True)
def _gather(values, index, weight, out):
    for n in prange(index.shape[0]):
        for c in range(values.shape[1]):
            out[n, c] = 0.0
        for k in range(index.shape[1]):
            row, factor = index[n, k], weight[n, k]
            for c in range(values.shape[1]):
                out[n, c] += factor * values[row, c]


@compiled()
def _scatter_weighted(grad, index, weight, out):
    for n in range(index.shape[0]):
        for k in range(index.shape[1]):
            row, factor = index[n, k], weight[n, k]
            for c in range(grad.shape[1]):
                out[row, c] += factor * grad[n, c]


@compiled(parallel=True, fastmath={"contract", "reassoc"})
def _row_products(grad, index, values, out):
    for n in prange(index.shape[0]):
        for k in range(index.shape[1]):
            row, total = index[n, k], np.float32(0.0)
            for c in range(grad.shape[1]):
                total += grad[n, c] * values[row, c]
            out[n, k] = total


@compiled()
def _scatter_rows(grad, index, out):
    for n in range(index.shape[0]):
        row = index[n]
        for c in range(grad.shape[1]):
            out[row, c] += grad[n, c]

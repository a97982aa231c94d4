"""Reference of the row gathers; symbols as in `lightprobe.kernels.gather`."""

import torch
from torch import Tensor


def weighted_gather(values: Tensor, index: Tensor, weight: Tensor) -> Tensor:
    """Return (N, C): sum over k of `weight[n, k] * values[index[n, k]]`."""
    return (values[index.long()] * weight[..., None]).sum(dim=1)


def scatter_weighted(grad: Tensor, index: Tensor, weight: Tensor, rows: int) -> Tensor:
    """Return the gradient (rows, C) to `values`: each destination row sums `weight * grad` over its uses."""
    return scatter_rows((weight[..., None] * grad[:, None, :]).flatten(0, 1), index.flatten(), rows)


def row_products(grad: Tensor, index: Tensor, values: Tensor) -> Tensor:
    """Return the gradient (N, K) to `weight`: the dot products of `grad` with the gathered rows."""
    return (values[index.long()] * grad[:, None, :]).sum(dim=2)


def scatter_rows(grad: Tensor, index: Tensor, rows: int) -> Tensor:
    """Return (rows, C): `grad` (N, C) summed into the rows named by `index` (N,)."""
    return torch.zeros(rows, grad.shape[1], dtype=grad.dtype, device=grad.device).index_add(0, index, grad)

"""Row gathers and their transposes with repeatable gradients: texture look-ups, vertex attributes, light taps.

PyTorch's own backward of `values[index]` is slow on the CPU and its sum order is not promised. Here every
destination row receives its contributions in the order of the index, whatever the number of threads; on a GPU
it sums integers, whose order does not matter.

    values (M, C)   rows to look up          index (N, K)   K rows for each of N queries
    weight (N, K)   factor of each row       result (N, C)  sum over k of weight[n, k] * values[index[n, k]]
"""

from typing import Any

import torch
from torch import Tensor

from lightprobe.kernels import dispatch


def weighted_gather(values: Tensor, index: Tensor, weight: Tensor) -> Tensor:
    """Return (N, C): sum over k of `weight[n, k] * values[index[n, k]]`.

    values (M, C) and weight (N, K): float32 (float64 goes to the reference), both differentiable, once; index
    (N, K): int32 or int64 in [0, M). Raises ValueError on wrong shapes or dtypes and IndexError on an index
    outside the rows.
    """
    dispatch.require_shape("values", values, None, None)
    dispatch.require_shape("index", index, None, None)
    dispatch.require_shape("weight", weight, *index.shape)
    dispatch.require_index("index", index, values.shape[0])
    return _WeightedGather.apply(values, index, weight)


def gather_rows(values: Tensor, index: Tensor) -> Tensor:
    """Return `values[index]`, shape (*index.shape, C); differentiable once in `values`, the gradient repeatable.

    values (M, C): float32 (float64 goes to the reference); index: int32 or int64 of any shape, in [0, M). Errors
    as in `weighted_gather`.
    """
    dispatch.require_shape("values", values, None, None)
    dispatch.require_index("index", index, values.shape[0])
    return _GatherRows.apply(values, index.reshape(-1)).reshape(*index.shape, values.shape[1])


def values_at(values: Tensor, index: Tensor) -> Tensor:
    """Return `values[index]` of values (M,) of any dtype, in the shape of the index; no repeatable gradient.

    index: int32 or int64, in [0, M). PyTorch takes two to four times as long for `values[index]`.
    """
    return values.index_select(0, index.reshape(-1)).reshape(index.shape)


def scatter_rows(values: Tensor, index: Tensor, rows: int) -> Tensor:
    """Return (rows, C): `values` (N, C) summed into the rows named by `index` (N,); `gather_rows` transposed.

    values: float32 (float64 goes to the reference), differentiable; index: int32 or int64 in [0, rows). Errors as
    in `weighted_gather`.
    """
    dispatch.require_shape("values", values, None, None)
    dispatch.require_shape("index", index, values.shape[0])
    dispatch.require_index("index", index, rows)
    return _ScatterRows.apply(values, index, rows)


def weighted_scatter(values: Tensor, index: Tensor, weight: Tensor, rows: int) -> Tensor:
    """Return (rows, C): `weight[n, k] * values[n]` summed into rows `index[n, k]`; `weighted_gather` transposed.

    values (N, C) and weight (N, K): float32 (float64 goes to the reference), not differentiable; index (N, K):
    int32 or int64 in [0, rows). Errors as in `weighted_gather`.
    """
    dispatch.require_shape("values", values, index.shape[0], None)
    dispatch.require_shape("index", index, None, None)
    dispatch.require_shape("weight", weight, *index.shape)
    dispatch.require_index("index", index, rows)
    values, weight = values.detach(), weight.detach()
    return dispatch.choose("gather", values, index, weight).scatter_weighted(values, index, weight, rows)


class _WeightedGather(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, index: Tensor, weight: Tensor) -> Tensor:
        ctx.save_for_backward(values, index, weight)
        return dispatch.choose("gather", values, index, weight).weighted_gather(values, index, weight)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, None, Tensor | None]:
        values, index, weight = ctx.saved_tensors
        backend = dispatch.choose("gather", values, index, weight)
        wants_values, _, wants_weight = ctx.needs_input_grad
        return (
            backend.scatter_weighted(grad, index, weight, values.shape[0]) if wants_values else None,
            None,
            backend.row_products(grad, index, values) if wants_weight else None,
        )


class _GatherRows(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, index: Tensor) -> Tensor:
        ctx.save_for_backward(index)
        ctx.rows = values.shape[0]
        return values.index_select(0, index)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None]:
        (index,) = ctx.saved_tensors
        return dispatch.choose("gather", grad, index).scatter_rows(grad, index, ctx.rows), None


class _ScatterRows(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, index: Tensor, rows: int) -> Tensor:
        ctx.save_for_backward(index)
        return dispatch.choose("gather", values, index).scatter_rows(values, index, rows)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None, None]:
        (index,) = ctx.saved_tensors
        return grad.index_select(0, index), None, None

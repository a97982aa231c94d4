"""Multiresolution hash grid: a point's features, read from small trainable tables (Mueller et al. 2022).

    points (N, 3) in [0, 1]^3     resolutions (L,) cells per edge of each level     table (L, T, F), T a power of two

Level l cuts the unit cube into r = resolutions[l] cells per edge and interpolates the F features of the cell's 8
corners trilinearly. Corner (x, y, z) lives in row x + (r + 1) (y + (r + 1) z) if all (r + 1)^3 corners fit into the
table, else in row (x ^ 2654435761 y ^ 805459861 z) mod T in unsigned 32-bit arithmetic; training sorts out collisions.
"""

from typing import Any

import torch
from torch import Tensor

from lightprobe.kernels import dispatch


def hash_encode(points: Tensor, table: Tensor, resolutions: Tensor) -> Tensor:
    """Return the features (N, L*F) of `points`, levels side by side; differentiable in both.

    points (N, 3), clamped to [0, 1], and table (L, T, F): float32 (float64 goes to the reference);
    resolutions (L,) integers from 1 to 2^20. Within a cell features are trilinear, and so the gradient to a
    point is the slope there; it is 0 along an axis on which the point is clamped. Gradients repeat to the
    bit. Differentiable once. Raises ValueError on wrong shapes or dtypes, a T that is no power of two, or a
    resolution out of range.
    """
    dispatch.require_shape("points", points, None, 3)
    dispatch.require_shape("table", table, None, None, None)
    dispatch.require_shape("resolutions", resolutions, table.shape[0])
    size = table.shape[1]
    if size < 1 or size & (size - 1):
        raise ValueError(f"The table must have a power of two of rows per level, not {size}.")
    cells = [int(cell) for cell in resolutions.tolist()]
    if any(not 1 <= cell <= 1 << 20 for cell in cells):
        raise ValueError(f"Resolutions must lie between 1 and 2^20 cells per edge, not {cells}.")
    return _HashEncode.apply(points, table, cells)


class _HashEncode(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, points: Tensor, table: Tensor, cells: list[int]) -> Tensor:
        ctx.save_for_backward(points, table)
        ctx.cells = cells
        return dispatch.choose("hash_grid", points, table).encode(points, table, cells)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        points, table = ctx.saved_tensors
        backend = dispatch.choose("hash_grid", points, grad)
        to_points, to_table = ctx.needs_input_grad[:2]
        return (
            backend.encode_backward_to_points(grad, points, table, ctx.cells) if to_points else None,
            backend.encode_backward(grad, points, ctx.cells, table.shape) if to_table else None,
            None,
        )

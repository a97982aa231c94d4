"""Reference of the sparse products, with sums in any order; symbols as in `lightprobe.kernels.sparse`."""

import numpy as np
import torch
from torch import Tensor

from lightprobe.kernels.sparse import CompressedRows


def product(matrix: CompressedRows, x: Tensor, rows: Tensor | None) -> Tensor:
    """Return the product (K, 3) of the rows (K,), all (M,) if None."""
    products = matrix.value[:, None].to(x.dtype) * x[matrix.column.long()]
    out = x.new_zeros(matrix.start.numel() - 1, 3).index_add_(0, _row_of_entry(matrix), products)
    return out if rows is None else out[rows.long()]


def product_transposed(matrix: CompressedRows, y: Tensor, rows: Tensor, bounds: np.ndarray) -> Tensor:
    """Return the transposed product (N, 3) on y (K, 3)."""
    whole = y.new_zeros(matrix.start.numel() - 1, 3).index_add_(0, rows.long(), y)
    products = matrix.value[:, None].to(y.dtype) * whole[_row_of_entry(matrix)]
    return y.new_zeros(matrix.columns, 3).index_add_(0, matrix.column.long(), products)


def _row_of_entry(matrix: CompressedRows) -> Tensor:
    entry = torch.arange(matrix.value.numel(), device=matrix.value.device)
    return torch.searchsorted(matrix.start[1:].long(), entry, right=True)

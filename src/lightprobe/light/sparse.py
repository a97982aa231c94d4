"""A constant sparse matrix acting on radiance triples, with its transpose stored beside it; see `kernels.sparse`."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import torch
from torch import Tensor

from lightprobe.kernels import CompressedRows, sparse_product, sparse_product_transposed

PARTS = 8  # partial sums of a transposed product over chosen rows: fixed, so that the thread count changes no bit


@dataclass(frozen=True)
class SparseOperator:
    """A constant matrix and its transpose."""

    forward: CompressedRows
    transpose: CompressedRows

    @staticmethod
    def build(matrix: scipy.sparse.csr_array, device: torch.device | str = "cpu") -> "SparseOperator":
        """Return the operator of a SciPy matrix; entries are rounded to float32, or shared where they are."""
        transpose = matrix.T.tocsr()
        if not matrix.has_sorted_indices:  # a transpose is sorted, stably, and quicker to find than an order
            matrix = transpose.T.tocsr()
        return SparseOperator(_compress(matrix, device), _compress(transpose, device))

    def apply(self, x: Tensor) -> Tensor:
        """Return matrix @ x, (rows, 3), from x (columns, 3); no gradient."""
        return sparse_product(self.forward, x)

    def adjoint(self, y: Tensor) -> Tensor:
        """Return matrix^T @ y, (columns, 3), from y (rows, 3); no gradient."""
        return sparse_product(self.transpose, y)


@dataclass(frozen=True)
class ChosenRows:
    """Some rows (K,) of an operator on a CPU; they cost only what they hold."""

    operator: SparseOperator
    rows: Tensor  # int32
    bounds: np.ndarray  # (PARTS + 1,) where each of the parts starts in `rows`; all hold about as many entries

    @staticmethod
    def of(operator: SparseOperator, rows: Tensor) -> "ChosenRows":
        """Return the rows (K,) of an operator."""
        rows = rows.int()
        start = operator.forward.start.numpy()
        filled = np.cumsum((start[1:] - start[:-1])[rows.numpy()])
        total = int(filled[-1]) if len(filled) else 0
        bounds = np.searchsorted(filled, np.arange(1, PARTS) * (total / PARTS))
        return ChosenRows(operator, rows, np.concatenate([[0], bounds, [len(rows)]]).astype(np.int32))

    def apply(self, x: Tensor) -> Tensor:
        """Return the product (K, 3) with x (columns, 3); no gradient."""
        return sparse_product(self.operator.forward, x, self.rows)

    def adjoint(self, y: Tensor) -> Tensor:
        """Return the transposed product (columns, 3) with y (K, 3); no gradient."""
        return sparse_product_transposed(self.operator.forward, y, self.rows, self.bounds)


def _compress(matrix: scipy.sparse.csr_array, device: torch.device | str) -> CompressedRows:
    matrix.sort_indices()
    small = torch.device(device).type == "cpu" and matrix.shape[1] <= 1 << 16
    return CompressedRows(
        torch.from_numpy(matrix.indptr.astype(np.int32, copy=False)).to(device),
        torch.from_numpy(matrix.indices.astype(np.uint16 if small else np.int32, copy=False)).to(device),
        torch.from_numpy(matrix.data.astype(np.float32, copy=False)).to(device),
        matrix.shape[1],
    )

"""A constant sparse matrix acting on radiance triples, and its transpose; see `kernels.sparse`."""

import functools
from dataclasses import dataclass

import numpy as np
import scipy.sparse
import torch
from torch import Tensor

from lightprobe.kernels import CompressedRows, sparse_product, sparse_product_transposed

PARTS = 8  # partial sums, at most, of a transposed product over chosen rows; the thread count changes none of its bits
_ENTRIES_PER_PART = 1 << 16  # with fewer, adding the partial sums up costs more than a thread saves


@dataclass(frozen=True)
class SparseOperator:
    """A constant matrix, and its transpose, found when first asked for: `ChosenRows` do without."""

    forward: CompressedRows

    @staticmethod
    def build(matrix: scipy.sparse.csr_array, device: torch.device | str = "cpu") -> "SparseOperator":
        """Return the operator of a SciPy matrix; entries are rounded to float32, or shared where they are.

        On a CPU rows keep the order of their entries. On a GPU they are sorted: lanes beside each other then
        read texels beside each other.
        """
        if torch.device(device).type != "cpu" and not matrix.has_sorted_indices:
            matrix = matrix.T.tocsr().T.tocsr()  # a transpose is sorted, and found sooner than an order
        return SparseOperator(_compress(matrix, device))

    @functools.cached_property
    def transpose(self) -> CompressedRows:
        """The transposed matrix, its rows sorted."""
        return _compress(self.matrix().T.tocsr(), self.forward.value.device)

    def matrix(self) -> scipy.sparse.csr_array:
        """Return the SciPy matrix, float32."""
        held = self.forward
        value, column, start = (part.cpu().numpy() for part in (held.value, held.column, held.start))
        entries = value, column.astype(np.int32), start
        return scipy.sparse.csr_array(entries, shape=(len(held.start) - 1, held.columns))

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
    bounds: np.ndarray  # (parts + 1,) where the parts, of about as many entries, start in `rows`

    @staticmethod
    def of(operator: SparseOperator, rows: Tensor) -> "ChosenRows":
        """Return the rows (K,) of an operator."""
        rows = rows.int()
        start = operator.forward.start.numpy()
        filled = np.cumsum((start[1:] - start[:-1])[rows.numpy()])
        total = int(filled[-1]) if len(filled) else 0
        parts = min(PARTS, 1 + total // _ENTRIES_PER_PART)
        bounds = np.searchsorted(filled, np.arange(1, parts) * (total / parts))
        return ChosenRows(operator, rows, np.concatenate([[0], bounds, [len(rows)]]).astype(np.int32))

    def apply(self, x: Tensor) -> Tensor:
        """Return the product (K, 3) with x (columns, 3); no gradient."""
        return sparse_product(self.operator.forward, x, self.rows)

    def adjoint(self, y: Tensor) -> Tensor:
        """Return the transposed product (columns, 3) with y (K, 3); no gradient."""
        return sparse_product_transposed(self.operator.forward, y, self.rows, self.bounds)


def _compress(matrix: scipy.sparse.csr_array, device: torch.device | str) -> CompressedRows:
    small = torch.device(device).type == "cpu" and matrix.shape[1] <= 1 << 16
    return CompressedRows(
        torch.from_numpy(matrix.indptr.astype(np.int32, copy=False)).to(device),
        torch.from_numpy(matrix.indices.astype(np.uint16 if small else np.int32, copy=False)).to(device),
        torch.from_numpy(matrix.data.astype(np.float32, copy=False)).to(device),
        matrix.shape[1],
    )

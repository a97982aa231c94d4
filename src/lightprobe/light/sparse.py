"""A constant sparse matrix acting on radiance triples, with its transpose stored beside it.

On the CPU both products are Numba loops, because PyTorch's own needs MKL, which not every build has; they are
row-parallel with a fixed order of summation, so results do not depend on the number of threads. On a GPU they are
PyTorch's CSR products, whose order of summation is not promised: bits may differ from call to call.
"""

import functools
from dataclasses import dataclass

import numba
import numpy as np
import scipy.sparse
import torch
from torch import Tensor

from lightprobe.core.jit import compiled, threads

PARTS = 8  # partial sums of a transposed product over chosen rows: fixed, so that the thread count changes no bit


@compiled(parallel=True, fastmath={"contract"})
def _multiply(start, column, value, rows, x, out):
    """Rows of x are padded to four, so that one vector holds one; four sums at a time hide the adds' latency."""
    padded = np.zeros((x.shape[0], 4), out.dtype)
    padded[:, :3] = x
    for q in numba.prange(rows.size):
        a0 = a1 = a2 = a3 = b0 = b1 = b2 = b3 = out.dtype.type(0)
        c0 = c1 = c2 = c3 = d0 = d1 = d2 = d3 = out.dtype.type(0)
        first, end = start[rows[q]], start[rows[q] + 1]
        whole = first + (end - first) // 4 * 4
        for k in range(first, whole, 4):
            j, w = column[k], value[k]
            a0, a1, a2, a3 = a0 + w * padded[j, 0], a1 + w * padded[j, 1], a2 + w * padded[j, 2], a3 + w * padded[j, 3]
            j, w = column[k + 1], value[k + 1]
            b0, b1, b2, b3 = b0 + w * padded[j, 0], b1 + w * padded[j, 1], b2 + w * padded[j, 2], b3 + w * padded[j, 3]
            j, w = column[k + 2], value[k + 2]
            c0, c1, c2, c3 = c0 + w * padded[j, 0], c1 + w * padded[j, 1], c2 + w * padded[j, 2], c3 + w * padded[j, 3]
            j, w = column[k + 3], value[k + 3]
            d0, d1, d2, d3 = d0 + w * padded[j, 0], d1 + w * padded[j, 1], d2 + w * padded[j, 2], d3 + w * padded[j, 3]
        for k in range(whole, end):
            j, w = column[k], value[k]
            a0, a1, a2, a3 = a0 + w * padded[j, 0], a1 + w * padded[j, 1], a2 + w * padded[j, 2], a3 + w * padded[j, 3]
        out[q, 0], out[q, 1], out[q, 2] = a0 + b0 + c0 + d0, a1 + b1 + c1 + d1, a2 + b2 + c2 + d2


@compiled(parallel=True, fastmath={"contract"})
def _spread(start, column, value, rows, bounds, y, parts):
    """Add the transposed product of the rows[bounds[c] : bounds[c + 1]] to parts[c] (columns, 4), for each c."""
    for c in numba.prange(parts.shape[0]):
        part = parts[c]
        for q in range(bounds[c], bounds[c + 1]):
            y0, y1, y2, y3 = y[q, 0], y[q, 1], y[q, 2], parts.dtype.type(0)
            for k in range(start[rows[q]], start[rows[q] + 1]):
                j, w = column[k], value[k]
                part[j, 0] += w * y0
                part[j, 1] += w * y1
                part[j, 2] += w * y2
                part[j, 3] += w * y3


@dataclass(frozen=True)
class CompressedRows:
    """One matrix in compressed sparse row form: int32 `start` (rows + 1,), `column`, and float32 `value`.

    The product waits for memory, so on the CPU columns are uint16 where that suffices, else int32.
    """

    start: Tensor
    column: Tensor
    value: Tensor
    columns: int

    def multiply(self, x: Tensor) -> Tensor:
        """Return the product (rows, 3) with x (columns, 3), on a CPU in x's dtype; no gradient."""
        x = x.detach()
        if x.is_cuda:
            return self._on_gpu @ x.to(self.value.dtype)
        rows = self.start.numel() - 1
        out = torch.empty((rows, 3), dtype=x.dtype)
        threads(2 * self.value.numel())
        _multiply(*self.stored(), np.arange(rows, dtype=np.int32), x.contiguous().numpy(), out.numpy())
        return out

    @functools.cached_property
    def _on_gpu(self) -> Tensor:
        """The matrix as PyTorch's, made once: its checks wait for the device."""
        shape = (self.start.numel() - 1, self.columns)
        return torch.sparse_csr_tensor(self.start, self.column, self.value, shape)

    def stored(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return start, column and value as arrays; on the CPU only."""
        return self.start.numpy(), self.column.numpy(), self.value.numpy()


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
        return self.forward.multiply(x)

    def adjoint(self, y: Tensor) -> Tensor:
        """Return matrix^T @ y, (columns, 3), from y (rows, 3); no gradient."""
        return self.transpose.multiply(y)


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
        out, matrix = torch.empty((len(self.rows), 3), dtype=x.dtype), self.operator.forward
        threads(len(self.rows) * 2 * matrix.value.numel() // matrix.start.numel())
        _multiply(*matrix.stored(), self.rows.numpy(), x.detach().contiguous().numpy(), out.numpy())
        return out

    def adjoint(self, y: Tensor) -> Tensor:
        """Return the transposed product (columns, 3) with y (K, 3); no gradient."""
        matrix = self.operator.forward
        parts = torch.zeros((PARTS, matrix.columns, 4), dtype=y.dtype)
        threads(len(self.rows) * 4 * matrix.value.numel() // matrix.start.numel())
        _spread(*matrix.stored(), self.rows.numpy(), self.bounds, y.detach().contiguous().numpy(), parts.numpy())
        return parts.sum(0)[:, :3]


def _compress(matrix: scipy.sparse.csr_array, device: torch.device | str) -> CompressedRows:
    matrix.sort_indices()
    small = torch.device(device).type == "cpu" and matrix.shape[1] <= 1 << 16
    return CompressedRows(
        torch.from_numpy(matrix.indptr.astype(np.int32, copy=False)).to(device),
        torch.from_numpy(matrix.indices.astype(np.uint16 if small else np.int32, copy=False)).to(device),
        torch.from_numpy(matrix.data.astype(np.float32, copy=False)).to(device),
        matrix.shape[1],
    )

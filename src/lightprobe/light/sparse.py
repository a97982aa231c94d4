"""A constant sparse matrix acting on radiance triples, with its transpose stored beside it.

Both products are row-parallel with a fixed order of summation, so results do not depend on the number of threads.
On the CPU the product is a Numba loop, because PyTorch's own needs MKL, which not every build has; on a GPU it is
PyTorch's CSR product.
"""

from dataclasses import dataclass

import numba
import numpy as np
import scipy.sparse
import torch
from torch import Tensor

from lightprobe.core.jit import compiled, threads


@compiled(parallel=True, fastmath={"contract"})
def _multiply(start: np.ndarray, column: np.ndarray, value: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Rows of x are padded to four, so that one vector holds one; four sums at a time hide the adds' latency."""
    for i in numba.prange(start.size - 1):
        a0 = a1 = a2 = a3 = b0 = b1 = b2 = b3 = out.dtype.type(0)
        c0 = c1 = c2 = c3 = d0 = d1 = d2 = d3 = out.dtype.type(0)
        first, end = start[i], start[i + 1]
        whole = first + (end - first) // 4 * 4
        for k in range(first, whole, 4):
            j, w = column[k], value[k]
            a0, a1, a2, a3 = a0 + w * x[j, 0], a1 + w * x[j, 1], a2 + w * x[j, 2], a3 + w * x[j, 3]
            j, w = column[k + 1], value[k + 1]
            b0, b1, b2, b3 = b0 + w * x[j, 0], b1 + w * x[j, 1], b2 + w * x[j, 2], b3 + w * x[j, 3]
            j, w = column[k + 2], value[k + 2]
            c0, c1, c2, c3 = c0 + w * x[j, 0], c1 + w * x[j, 1], c2 + w * x[j, 2], c3 + w * x[j, 3]
            j, w = column[k + 3], value[k + 3]
            d0, d1, d2, d3 = d0 + w * x[j, 0], d1 + w * x[j, 1], d2 + w * x[j, 2], d3 + w * x[j, 3]
        for k in range(whole, end):
            j, w = column[k], value[k]
            a0, a1, a2, a3 = a0 + w * x[j, 0], a1 + w * x[j, 1], a2 + w * x[j, 2], a3 + w * x[j, 3]
        out[i, 0], out[i, 1], out[i, 2] = a0 + b0 + c0 + d0, a1 + b1 + c1 + d1, a2 + b2 + c2 + d2


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
        """Return the product (rows, 3) with x (columns, 3), in x's dtype; no gradient."""
        x = x.detach()
        rows = self.start.numel() - 1
        if x.is_cuda:
            shape = (rows, self.columns)
            return torch.sparse_csr_tensor(self.start, self.column, self.value.to(x.dtype), shape) @ x
        out = torch.empty((rows, 3), dtype=x.dtype)
        padded = torch.nn.functional.pad(x, (0, 1))
        threads(2 * self.value.numel())
        _multiply(self.start.numpy(), self.column.numpy(), self.value.numpy(), padded.numpy(), out.numpy())
        return out


@dataclass(frozen=True)
class SparseOperator:
    """A constant matrix and its transpose."""

    forward: CompressedRows
    transpose: CompressedRows

    @staticmethod
    def build(matrix: scipy.sparse.csr_array, device: torch.device | str = "cpu") -> "SparseOperator":
        """Return the operator of a SciPy matrix; entries are rounded to float32."""
        return SparseOperator(_compress(matrix, device), _compress(matrix.T.tocsr(), device))

    def apply(self, x: Tensor) -> Tensor:
        """Return matrix @ x, (rows, 3), from x (columns, 3); no gradient."""
        return self.forward.multiply(x)

    def adjoint(self, y: Tensor) -> Tensor:
        """Return matrix^T @ y, (columns, 3), from y (rows, 3); no gradient."""
        return self.transpose.multiply(y)

    @property
    def nonzeros(self) -> int:
        """Number of stored entries."""
        return self.forward.value.numel()


def _compress(matrix: scipy.sparse.csr_array, device: torch.device | str) -> CompressedRows:
    matrix.sort_indices()
    small = torch.device(device).type == "cpu" and matrix.shape[1] <= 1 << 16
    return CompressedRows(
        torch.from_numpy(matrix.indptr.astype(np.int32)).to(device),
        torch.from_numpy(matrix.indices.astype(np.uint16 if small else np.int32)).to(device),
        torch.from_numpy(matrix.data.astype(np.float32)).to(device),
        matrix.shape[1],
    )

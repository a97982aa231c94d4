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


@compiled(parallel=True)
def _multiply(start: np.ndarray, column: np.ndarray, value: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    for i in numba.prange(start.size - 1):
        red = green = blue = out.dtype.type(0)
        for k in range(start[i], start[i + 1]):
            j, w = column[k], value[k]
            red += w * x[j, 0]
            green += w * x[j, 1]
            blue += w * x[j, 2]
        out[i, 0], out[i, 1], out[i, 2] = red, green, blue


@dataclass(frozen=True)
class CompressedRows:
    """One matrix in compressed sparse row form: int32 `start` (rows + 1,) and `column`, float32 `value`."""

    start: Tensor
    column: Tensor
    value: Tensor
    columns: int

    def multiply(self, x: Tensor) -> Tensor:
        """Return the product (rows, 3) with x (columns, 3), in x's dtype; no gradient."""
        x = x.detach().contiguous()
        rows = self.start.numel() - 1
        if x.is_cuda:
            shape = (rows, self.columns)
            return torch.sparse_csr_tensor(self.start, self.column, self.value.to(x.dtype), shape) @ x
        out = torch.empty((rows, 3), dtype=x.dtype)
        threads(2 * self.value.numel())
        _multiply(self.start.numpy(), self.column.numpy(), self.value.numpy(), x.numpy(), out.numpy())
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
    return CompressedRows(
        torch.from_numpy(matrix.indptr.astype(np.int32)).to(device),
        torch.from_numpy(matrix.indices.astype(np.int32)).to(device),
        torch.from_numpy(matrix.data.astype(np.float32)).to(device),
        matrix.shape[1],
    )

"""Products of a constant sparse matrix with radiance triples, and of its transpose; rows from permuted columns.

    matrix (M, N) in compressed sparse rows: row r has the entries start[r] .. start[r + 1] of `column` and `value`
    x (N, 3)   product y (M, 3), or of chosen rows alone (K, 3): they cost only what they hold

On the CPU both are loops, because PyTorch's own needs MKL, which not every build has; sums have a fixed order, so
results do not depend on the number of threads. On a GPU only whole products are formed, by Triton in a fixed order as
well: PyTorch's CSR product took 0.47 ms there for 6.3 million entries, 3 % of what memory allows. The matrix is
constant: to differentiate a product in x, multiply its gradient by the transpose.
"""

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from torch import Tensor

from lightprobe.kernels import dispatch


@dataclass(frozen=True)
class CompressedRows:
    """One matrix: int32 `start` (M + 1,), `column` (entries,) in [0, columns) and float32 `value` (entries,).

    Products are limited by memory, so on the CPU columns are uint16 where 16 bits suffice, else int32. Products do
    not check columns: the builder of a matrix does.
    """

    start: Tensor
    column: Tensor
    value: Tensor
    columns: int  # N


def sparse_product(matrix: CompressedRows, x: Tensor, rows: Tensor | None = None) -> Tensor:
    """Return the product (M, 3) with x (N, 3), or only its `rows` (K,) int32, as (K, 3); not differentiable.

    x: float32 or float64, and on a CPU so is the product. Rows are chosen on a CPU only, and must lie in [0,
    M). Raises ValueError on a wrong shape.
    """
    dispatch.require_shape("x", x, matrix.columns, 3)
    return _backend(matrix).product(matrix, x.detach(), rows)


def sparse_product_transposed(matrix: CompressedRows, y: Tensor, rows: Tensor, bounds: np.ndarray) -> Tensor:
    """Return the transpose of the product of `rows` (K,), (N, 3), on y (K, 3); not differentiable.

    y, rows and errors as in `sparse_product`. bounds (C + 1,) int32, from 0 to K, cuts the rows into parts
    that are summed apart, each in order, and then together: they, and not the number of threads, fix the
    bits.
    """
    dispatch.require_shape("y", y, rows.numel(), 3)
    return _backend(matrix).product_transposed(matrix, y.detach(), rows, bounds)


def _backend(matrix: CompressedRows) -> ModuleType:
    """Return the backend by device alone: the CPU's loops take either dtype."""
    return dispatch.choose("sparse", matrix.start)


def permute_rows(
    start: np.ndarray,
    column: np.ndarray,
    value: np.ndarray,
    which: np.ndarray,
    by: np.ndarray,
    source: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return compressed rows: row t has the entries of row which[t], column n renamed to source[by[t], n].

    start (K + 1,), column and value (entries,): the old rows; which (T,) in [0, K); by (T,) in [0, S); source
    (S, N) int32. Returns start (T + 1,) and value of the given dtypes, column int32; entries keep their order, so
    that they are not sorted. NumPy arrays on the CPU; indices are not checked.
    """
    new_start = np.concatenate([[0], np.cumsum(np.diff(start)[which])]).astype(start.dtype)
    new_column, new_value = np.empty(new_start[-1], np.int32), np.empty(new_start[-1], value.dtype)
    loops = dispatch.compiled_loops("sparse", len(new_column))
    loops.permute(start, column, value, which, by, source, new_start, new_column, new_value)
    return new_start, new_column, new_value

"""Sparse rows made from others by a permutation of their columns.

    rows r in compressed sparse form: entries start[r] .. start[r + 1] of `column` and `value`
    row t of the result holds the entries of row which[t], with column n renamed to source[by[t], n]

Entries keep the order of the row that they come from, so that they are not sorted. Float64 or float32 values
are copied as they are; indices are integers of any size. NumPy arrays on the CPU; not differentiable.
"""

import numpy as np

from lightprobe.kernels import dispatch


def permute_rows(
    start: np.ndarray,
    column: np.ndarray,
    value: np.ndarray,
    which: np.ndarray,
    by: np.ndarray,
    source: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return start (T + 1,) like `start`, column (entries,) int32 and value (entries,) like `value` of the T
    new rows.

    start (K + 1,), column and value (entries,): the old rows. which (T,) in [0, K), by (T,) in [0, S): the
    row and the permutation that make each new one. source (S, N) int32. Indices are not looked at: whoever
    made them answers.
    """
    new_start = np.concatenate([[0], np.cumsum(np.diff(start)[which])]).astype(start.dtype)
    new_column, new_value = np.empty(new_start[-1], np.int32), np.empty(new_start[-1], value.dtype)
    dispatch.choose("permuted_rows").permute(
        start, column, value, which, by, source, new_start, new_column, new_value
    )
    return new_start, new_column, new_value

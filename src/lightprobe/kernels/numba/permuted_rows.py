"""Numba body of the permuted rows; symbols as in `lightprobe.kernels.permuted_rows`. Every row is written
apart.
"""

import numpy as np
from numba import prange

from lightprobe.core.jit import compiled, threads


def permute(
    start: np.ndarray,
    column: np.ndarray,
    value: np.ndarray,
    which: np.ndarray,
    by: np.ndarray,
    source: np.ndarray,
    new_start: np.ndarray,
    new_column: np.ndarray,
    new_value: np.ndarray,
) -> None:
    """Write the T new rows, which start at `new_start` (T + 1,), into `new_column` and `new_value`
    (entries,).
    """
    threads(len(new_column))
    _permute(start, column, value, which, by, source, new_start, new_column, new_value)


@compiled(parallel=True)
def _permute(start, column, value, which, by, source, new_start, new_column, new_value):
    for row in prange(len(which)):
        nodes, at = source[by[row]], new_start[row]
        for k in range(start[which[row]], start[which[row] + 1]):
            new_column[at], new_value[at] = nodes[column[k]], value[k]
            at += 1

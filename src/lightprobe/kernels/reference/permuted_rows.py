"""Plain body of the permuted rows; symbols as in `lightprobe.kernels.permuted_rows`."""

import numpy as np


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
    for row, (origin, permutation) in enumerate(zip(which, by, strict=True)):
        old, new = slice(start[origin], start[origin + 1]), slice(new_start[row], new_start[row + 1])
        new_column[new], new_value[new] = source[permutation, column[old]], value[old]

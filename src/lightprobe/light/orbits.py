"""Rows of a constant operator from one row of each orbit of the cube's symmetries.

The 48 turns and mirrorings of the cube carry the texels of a cubemap onto one another, and with them whatever
is built from directions and faces alone. So if symmetry k carries texel t onto texel f, and node m onto node
n, then the weight of node m in the row of t is that of n in the row of f. Of 6 R^2 rows only R (R + 2) / 8
need computing, those of the first texel of each orbit; the others hold the same numbers elsewhere.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import torch

from lightprobe.kernels import permute_rows
from lightprobe.light import cubemap


@dataclass(frozen=True)
class Orbits:
    """The orbits of a cubemap's texels: `first[which[t]]` is the first texel of t's, and `by[t]` carries t
    onto it.
    """

    first: np.ndarray  # (K,) flat texel indices, ascending
    which: np.ndarray  # (6 R^2,) in 0..K-1
    by: np.ndarray  # (6 R^2,) in 0..47

    @staticmethod
    def of(resolution: int) -> "Orbits":
        """Return the orbits of 6 R^2 texels."""
        first, by = cubemap.symmetries(resolution, torch.device("cpu"))[0].min(0)
        unique, which = torch.unique(first, return_inverse=True)
        return Orbits(unique.numpy(), which.numpy(), by.numpy())


def sources(resolution: int) -> np.ndarray:
    """Return the texel that each symmetry carries onto each texel, (48, 6 R^2) int32."""
    index, _ = cubemap.symmetries(resolution, torch.device("cpu"))
    texel = torch.arange(index.shape[1], dtype=torch.int32).expand_as(index)
    return torch.empty_like(texel).scatter_(1, index, texel).numpy()


def unfold(
    rows: scipy.sparse.csr_array, which: np.ndarray, by: np.ndarray, source: np.ndarray
) -> scipy.sparse.csr_array:
    """Return rows (T, N) from those of the orbits' first texels (K, N): row t is row `which[t]`, carried
    back.

    which and by: (T,) as in `Orbits`. source: (48, N) int32, the node that each symmetry carries onto each
    node. Entries keep the order of the row that they come from, so that they are not sorted.
    """
    start, index, weight = permute_rows(rows.indptr, rows.indices, rows.data, which, by, source)
    return scipy.sparse.csr_array((weight, index, start), shape=(len(which), rows.shape[1]))

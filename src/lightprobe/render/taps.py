"""Pixels' look-ups in the levels of a prefiltered light, as one linear map of the light and its transpose."""

import functools

import numpy as np
import scipy.sparse
import torch
from torch import Tensor

from lightprobe.kernels import weighted_gather, weighted_scatter
from lightprobe.light.prefilter import Prefilter, PrefilterPart
from lightprobe.light.sparse import SparseOperator

Taps = list[
    tuple[Tensor, Tensor]
]  # look-ups of index (P, K) and weight (P, K); their rows stand one below the other


class SparseTaps:
    """A CPU's look-ups in a light's levels: only texels that somebody looks up are prefiltered."""

    def __init__(self, taps: Taps, prefilter: Prefilter):
        """Take the look-ups in the levels of `prefilter`."""
        self._taps, self._prefilter = taps, prefilter

    def select(self, rows: Tensor) -> "SparseTaps":
        """Return the look-ups of the pixels at `rows` (K,)."""
        return SparseTaps(_selected(self._taps, rows), self._prefilter)

    @functools.cached_property
    def _operators(self) -> tuple[PrefilterPart, SparseOperator]:
        """The levels that are looked up, and the look-ups; made at the first application."""
        used, matrix = _tap_matrix(self._taps, self._prefilter.total)
        return PrefilterPart(self._prefilter, used), SparseOperator.build(matrix)

    def apply(self, env: Tensor) -> tuple[Tensor, Tensor]:
        """Return what is looked up (rows, 3) of env (6, R, R, 3), and its blocks (384, 3)."""
        part, taps = self._operators
        levels = part.apply(env)
        return taps.apply(levels[: part.first_block]), levels[part.first_block :]

    def adjoint(self, lobes: Tensor, blocks: Tensor) -> Tensor:
        """Return the transpose of `apply`, (6, R, R, 3)."""
        part, taps = self._operators
        return part.adjoint(torch.cat([taps.adjoint(lobes), blocks]))


class GatheredTaps:
    """The same on a GPU, where finding out which texels these are would take longer than they do."""

    def __init__(self, taps: Taps, prefilter: Prefilter):
        """Take the look-ups in the levels of `prefilter`."""
        self._taps, self._prefilter = taps, prefilter

    def select(self, rows: Tensor) -> "GatheredTaps":
        """Return the look-ups of the pixels at `rows` (K,)."""
        return GatheredTaps(_selected(self._taps, rows), self._prefilter)

    def apply(self, env: Tensor) -> tuple[Tensor, Tensor]:
        """Return what is looked up (rows, 3) of env (6, R, R, 3), and its blocks (384, 3)."""
        levels, blocks = self._prefilter.apply(env).tensor_split([self._prefilter.first_block])
        return torch.cat([weighted_gather(levels, *taps) for taps in self._taps]), blocks

    def adjoint(self, lobes: Tensor, blocks: Tensor) -> Tensor:
        """Return the transpose of `apply`, (6, R, R, 3)."""
        count = self._prefilter.first_block
        levels = lobes.new_zeros(count, 3)
        for part, taps in zip(lobes.split([len(index) for index, _ in self._taps]), self._taps, strict=True):
            levels += weighted_scatter(part, *taps, count)
        return self._prefilter.adjoint(torch.cat([levels, blocks]))


def _selected(taps: Taps, rows: Tensor) -> Taps:
    return [(index[rows], weight[rows]) for index, weight in taps]


def look_up(device: torch.device) -> type[SparseTaps] | type[GatheredTaps]:
    """Return the class of look-ups for a device."""
    return SparseTaps if device.type == "cpu" else GatheredTaps


def _tap_matrix(taps: Taps, count: int) -> tuple[Tensor, scipy.sparse.csr_array]:
    """Return the looked-up texels (U,) int64 among `count`, and the look-ups as a matrix (rows, U)."""
    index = np.concatenate([index.numpy().ravel() for index, _ in taps])
    weight = np.concatenate([weight.numpy().ravel() for _, weight in taps])
    lengths = np.repeat([index.shape[1] for index, _ in taps], [len(index) for index, _ in taps])
    filled = weight > 0
    looked_up = np.zeros(count, bool)
    looked_up[index[filled]] = True
    place = np.cumsum(looked_up) - 1
    # Texels that only weightless taps name get some place; it does not matter which.
    start = np.concatenate([[0], np.cumsum(lengths)])
    used = np.flatnonzero(looked_up)
    column = np.where(filled, place[index], 0)
    return torch.from_numpy(used), scipy.sparse.csr_array(
        (weight, column, start), shape=(len(lengths), len(used))
    )

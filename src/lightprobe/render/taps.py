"""Pixels' look-ups in the levels of a prefiltered light, as one linear map of the light and its transpose."""

import functools
from typing import Self

import numpy as np
import scipy.sparse
import torch
from torch import Tensor

from lightprobe.kernels import weighted_gather, weighted_scatter
from lightprobe.light.prefilter import Prefilter, PrefilterPart
from lightprobe.light.sparse import SparseOperator

_FEW, _COARSE = 1024, 16  # rows and texels along an edge of a light up to which a matrix is written out
# look-ups of index (P, K) and weight (P, K); their rows stand one below the other
Taps = list[tuple[Tensor, Tensor]]


class GatheredTaps:
    """Look-ups in all levels of a prefiltered light: for a GPU."""

    def __init__(self, taps: Taps, prefilter: Prefilter):
        """Take the look-ups in the levels of `prefilter`."""
        self._taps, self._prefilter = taps, prefilter

    def select(self, rows: Tensor) -> Self:
        """Return the look-ups of the pixels at `rows` (K,)."""
        return type(self)([(index[rows], weight[rows]) for index, weight in self._taps], self._prefilter)

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


class SparseTaps(GatheredTaps):
    """Look-ups in only the needed texels of the levels: for a CPU; finding them would take a GPU longer."""

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


class DenseTaps(GatheredTaps):
    """Look-ups written out as one matrix of the light's texels: for a CPU, few pixels and a coarse light."""

    @functools.cached_property
    def _matrix(self) -> Tensor:
        """The matrix (rows, 6 R^2); made at the first application."""
        levels = self._prefilter.dense_levels
        return torch.cat([weighted_gather(levels, *taps) for taps in self._taps])

    def apply(self, env: Tensor) -> tuple[Tensor, Tensor]:
        """Return what is looked up (rows, 3) of env (6, R, R, 3), and its blocks (384, 3)."""
        self._prefilter.check(env)
        texels = env.detach().reshape(-1, 3)
        return self._matrix @ texels, self._prefilter.blocks.apply(texels)

    def adjoint(self, lobes: Tensor, blocks: Tensor) -> Tensor:
        """Return the transpose of `apply`, (6, R, R, 3)."""
        size = self._prefilter.resolution
        texels = (lobes.T @ self._matrix).T + self._prefilter.blocks.adjoint(blocks)
        return texels.reshape(6, size, size, 3)


def look_up(taps: Taps, prefilter: Prefilter, *, often: bool) -> GatheredTaps:
    """Return the look-ups in the levels of `prefilter` in their fastest form; often: in many lights one after the other."""
    if taps[0][0].device.type != "cpu":
        return GatheredTaps(taps, prefilter)
    few = sum(len(index) for index, _ in taps) <= _FEW and prefilter.resolution <= _COARSE
    return DenseTaps(taps, prefilter) if often and few else SparseTaps(taps, prefilter)


def _tap_matrix(taps: Taps, count: int) -> tuple[Tensor, scipy.sparse.csr_array]:
    """Return the looked-up texels (U,) int64 among `count`, and the look-ups as a matrix (rows, U)."""
    index = np.concatenate([index.numpy().ravel() for index, _ in taps])
    weight = np.concatenate([weight.numpy().ravel() for _, weight in taps])
    lengths = np.repeat([index.shape[1] for index, _ in taps], [len(index) for index, _ in taps])
    filled = weight > 0
    looked_up = np.zeros(count, bool)
    looked_up[index[filled]] = True
    place = np.cumsum(looked_up) - 1
    column = np.where(filled, place[index], 0)  # taps without weight get any column
    used = np.flatnonzero(looked_up)
    entries = weight, column, np.concatenate([[0], np.cumsum(lengths)])
    return torch.from_numpy(used), scipy.sparse.csr_array(entries, shape=(len(lengths), len(used)))

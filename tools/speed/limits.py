"""What the machine can do at most, with the threads that the kernels get: copying memory, and multiplying and
adding.

The limits are the best of several trials, not the median: whatever disturbs a trial only makes it look
slower.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numba import prange

from lightprobe.core.jit import compiled, threads
from speed.clock import times

_CHAIN = 16  # multiply-adds on a value between its load and its store
_VALUES = 1024  # float32 of each thread, which stay in the first-level cache
_COPIED = 1 << 25  # float32 of a copy, far more than any cache holds


@dataclass(frozen=True)
class Limits:
    """The machine's rates with all threads that PyTorch uses."""

    copy: float  # bytes/s, read and written ones both counted
    registers: (
        float  # float32 operations/s of independent multiply-adds in registers; one counts as two operations
    )
    matrix: float  # the same of PyTorch's product of two matrices

    @property
    def arithmetic(self) -> float:
        """The larger rate of the two ways to multiply and add."""
        return max(self.registers, self.matrix)


def measure_limits(trials: int) -> Limits:
    """Return the limits, each the best of `trials`."""
    return Limits(_copy_rate(trials), _register_rate(trials), _matrix_rate(trials))


def _copy_rate(trials: int) -> float:
    source, target = torch.rand(_COPIED), torch.empty(_COPIED)
    return 2 * 4 * _COPIED / min(times(lambda: target.copy_(source), trials))


def _register_rate(trials: int) -> float:
    workers, rounds = threads(1 << 40), 1 << 13
    values = np.ones((workers, _VALUES), np.float32)
    work = 2 * _CHAIN * values.size * rounds
    # A trial takes milliseconds and is as slow as its most disturbed thread, so there are many.
    return work / min(times(lambda: _multiply_add(values, rounds), 20 * trials))


def _matrix_rate(trials: int) -> float:
    side = 1536
    a = torch.rand(side, side)
    return 2 * side**3 / min(times(lambda: a @ a, trials))


@compiled(parallel=True, fastmath={"contract"})
def _multiply_add(values, rounds):
    for worker in prange(values.shape[0]):
        row = values[worker]
        for _ in range(rounds):
            for j in range(row.size):
                x = row[j]
                for _ in range(_CHAIN):
                    x = x * np.float32(0.25) + np.float32(0.75)
                row[j] = x

"""Times of calls, what the machine can do at most, and tables of how a cost grows with a size."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch

WARM = 2  # steps of a training that are not counted
_COPIED, _SIDE = 1 << 25, 1536  # float32 of a copy, more than any cache holds; side of the matrices


def seconds(work: Callable[[], object], repeats: int, *, warm_up: bool = True) -> float:
    """Return the median time of a call, after one that warms up."""
    return statistics.median(times(work, repeats, warm_up=warm_up))


def times(work: Callable[[], object], repeats: int, *, warm_up: bool = True) -> list[float]:
    """Return the seconds of every call but the one that warms up."""
    if warm_up:
        work()
    found = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        found.append(time.perf_counter() - begin)
    return found


def median_gap(stamps: Sequence[float]) -> float:
    """Return the median time between the ends of steps, the first `WARM` steps left out."""
    return statistics.median(after - before for before, after in pairwise(stamps[WARM - 1 :]))


@dataclass(frozen=True)
class Limits:
    """A machine's rates: the best of several trials, since whatever disturbs a trial only makes it look slower."""

    copy: float  # bytes/s, read and written ones both counted
    arithmetic: float  # float32 operations/s of a product of matrices; a multiply-add counts as two


def measure_limits(trials: int) -> Limits:
    """Return the limits of the CPU with all threads that PyTorch uses."""
    source, target, a = torch.rand(_COPIED), torch.empty(_COPIED), torch.rand(_SIDE, _SIDE)
    copied, product = (min(times(work, trials)) for work in (lambda: target.copy_(source), lambda: a @ a))
    return Limits(2 * 4 * _COPIED / copied, 2 * _SIDE**3 / product)


def growth_rows(name: str, cases: Mapping[float, Mapping[str, float]], scale: float = 1000.0) -> list[str]:
    """Return the table of costs times `scale` by size, and the power of the size with which each grows.

    cases: size -> what -> seconds, or bytes.
    """
    sizes = list(cases)
    rows = [f"| {name} | {' | '.join(f'{size:,.0f}' for size in sizes)} | exponent |"]
    rows.append("| --- |" + " ---: |" * (len(sizes) + 1))
    for what in cases[sizes[0]]:
        costs = [cases[size][what] for size in sizes]
        exponent = np.polyfit(np.log(sizes), np.log(costs), 1)[0]
        rows.append(f"| {what} | {' | '.join(f'{scale * value:.1f}' for value in costs)} | {exponent:.2f} |")
    return rows

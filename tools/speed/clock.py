"""Times of calls and of the parts of a step, in seconds."""

import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise

WARM = 2  # steps of a training that are not counted


def seconds(work: Callable[[], object], repeats: int, *, warm_up: bool = True) -> float:
    """Return the median time of a call, after one that warms up."""
    return statistics.median(times(work, repeats, warm_up=warm_up))


def times(work: Callable[[], object], repeats: int, *, warm_up: bool = True) -> list[float]:
    """Return the time of every call but the one that warms up."""
    if warm_up:
        work()
    found = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        found.append(time.perf_counter() - begin)
    return found


class Parts:
    """The times of the named parts of something that is done many times."""

    def __init__(self) -> None:
        self._seconds: dict[str, list[float]] = {}

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Time a block as the part `name` of one round."""
        begin = time.perf_counter()
        yield
        self._seconds.setdefault(name, []).append(time.perf_counter() - begin)

    def medians(self, skip: int = 0) -> dict[str, float]:
        """Return the median time of each part over all rounds but the first `skip`."""
        return {name: statistics.median(found[skip:]) for name, found in self._seconds.items()}


def median_gap(stamps: list[float]) -> float:
    """Return the median time between the ends of steps, the first `WARM` steps left out."""
    return statistics.median(after - before for before, after in pairwise(stamps[WARM - 1 :]))

"""Work on many things side by side in threads, for libraries that release Python's lock."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_threads(
    work: Callable[[Item], Result], items: Iterable[Item], done: Callable[[], None] = lambda: None
) -> list[Result]:
    """Return what `work` makes of each item, in order, worked on by as many threads as PyTorch may use.

    The error of the first item that fails is raised. Numba's loops have threads of their own and are not for
    `work`. done: called in the calling thread for each item that is finished.
    """
    found = []
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        for result in pool.map(work, items):
            found.append(result)
            done()
    return found

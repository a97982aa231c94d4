"""A number of threads that does not depend on what a test runner leaves to each of its processes."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import torch


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Let PyTorch and the compiled loops use up to `count` threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def assert_same_bits(compute: Callable[[], Iterable[Any]]) -> None:
    """Compute arrays or tensors twice on two threads and once on one: the bits of all are the same."""
    results = []
    for count in (2, 2, 1):
        with torch_threads(count):
            results.append([torch.as_tensor(part) for part in compute()])
    for one, again, alone in zip(*results, strict=True):
        assert torch.equal(one, again)
        assert torch.equal(one, alone)

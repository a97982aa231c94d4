"""Several processes of one training as threads of the test's own, of which one computes at a time."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from lightprobe.core.processes import Processes


@dataclass(frozen=True)
class _Table:
    """Where the tensors of one exchange lie, and whose turn it is to compute: compiled loops may bear no
    company.
    """

    barrier: threading.Barrier
    turn: threading.Lock = field(default_factory=threading.Lock)
    laid: dict[int, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class ThreadedProcesses(Processes):
    """Exchanges with other threads what `Processes` does with other processes."""

    table: _Table = field(default_factory=lambda: _Table(threading.Barrier(1)))

    def add_up(self, tensor: Tensor) -> Tensor:
        table = self.table
        table.laid[self.rank] = tensor.clone()
        table.turn.release()
        try:
            table.barrier.wait(timeout=60)
            total = torch.stack([table.laid[rank] for rank in range(self.count)]).sum(0)
            table.barrier.wait(timeout=60)
        finally:
            table.turn.acquire()
        return tensor.copy_(total)


def in_processes(count: int, work: Callable[[Processes], Any]) -> list[Any]:
    """Return the results of `work` in each of `count` processes; raise what one raises, and not what that led
    to.
    """
    table = _Table(threading.Barrier(count))

    def run(rank: int) -> Any:
        with table.turn:
            try:
                return work(ThreadedProcesses(rank, count, table=table))
            except BaseException:
                table.barrier.abort()
                raise

    with ThreadPoolExecutor(count) as pool:
        futures = [pool.submit(run, rank) for rank in range(count)]
    errors = sorted(filter(None, (f.exception() for f in futures)), key=_is_consequence)
    if errors:
        raise errors[0]
    return [future.result() for future in futures]


def _is_consequence(error: BaseException) -> bool:
    return any(isinstance(each, threading.BrokenBarrierError) for each in (error, error.__cause__))

"""Several processes that train one network together, started by `torchrun`: who they are and what they
exchange.

All of them draw the same random numbers and hold the same parameters. Each computes its part of a step, and
the mean of what they found is the step's: the same in all, and up to rounding what one process alone would
have found. Only the first one writes files. Without `torchrun` there is one process, `ALONE`, which exchanges
nothing.
"""

import contextlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import timedelta
from typing import Any, TypeVar

import torch
import torch.distributed as dist
from torch import Tensor

from lightprobe.core.device import resolve_device
from lightprobe.core.ending import LOST, ending_with_torchrun, started_together
from lightprobe.core.errors import ConfigError, ResourceError

_LONGEST_WAIT = timedelta(hours=1)  # for the slowest process; one that has ended is noticed sooner

_CPU = torch.device("cpu")

Result = TypeVar("Result")


@dataclass(frozen=True)
class Processes:
    """The processes of one training, as one of them sees them."""

    rank: int = 0
    count: int = 1
    device: torch.device = _CPU  # where this process computes

    @property
    def alone(self) -> bool:
        """Whether there are no others."""
        return self.count == 1

    @property
    def first(self) -> bool:
        """Whether this process is the one that writes files."""
        return self.rank == 0

    def part(self, length: int) -> slice:
        """Return which of `length` things are this process's own; the parts' lengths differ by at most one."""
        return slice(self.rank * length // self.count, (self.rank + 1) * length // self.count)

    def average(self, tensor: Tensor) -> Tensor:
        """Replace a tensor of any shape by the mean of all processes' ones, and return it; no gradients."""
        return self.add_up(tensor).div_(self.count)

    def sum(self, tensor: Tensor) -> Tensor:
        """Return the sum of all processes' tensors, of one but any shape, from which all must go on to the
        same loss.

        Differentiable: the gradient is that of the sum of the processes' losses, so that of their mean is
        right.
        """
        total: Tensor = _Sum.apply(tensor, self)
        return total

    def wait(self) -> None:
        """Wait until all processes have come here."""
        self.agree(0)

    def first_then_others(self, work: Callable[[], Result]) -> Result:
        """Do `work` in the first process and, once it is done there, in the others; return its result."""
        if not self.first:
            self.wait()
        result = work()
        if self.first:
            self.wait()
        return result

    def agree(self, number: int) -> bool:
        """Return whether all processes have come here with the same number."""
        numbers = torch.zeros(self.count, dtype=torch.int64, device=self.device)
        numbers[self.rank] = number
        with _noticing_ends():  # a GPU is asked for the sum above, and waited for only here
            return bool((self.add_up(numbers) == number).all())

    def add_up(self, tensor: Tensor) -> Tensor:
        """Replace a tensor of any shape by the sum of all processes' ones, and return it; no gradients."""
        if not self.alone:
            with _noticing_ends():
                dist.all_reduce(tensor)
        return tensor


ALONE = Processes()
"""The one process of a training that was not started by `torchrun`."""


class _Sum(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, tensor: Tensor, processes: Processes) -> Tensor:
        ctx.count = processes.count
        return processes.add_up(tensor.clone())

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None]:
        return grad * ctx.count, None  # the others' gradients are the same and need not be asked for


@contextlib.contextmanager
def joined(device: str) -> Iterator[Processes]:
    """Join the processes that `torchrun` started; without it, or with one process, there is nothing to join.

    device: as for `resolve_device`; of several processes each gets a GPU of its own, or all compute on the
    CPU. Raises `ConfigError` for a device that they cannot have, `ResourceError` when another one has ended.
    """
    count = started_together()
    if count == 1:
        yield Processes(device=resolve_device(device))
        return
    where = _own_device(device)
    with ending_with_torchrun():
        with _noticing_ends():
            if where.type == "cuda":
                torch.cuda.set_device(where)
                dist.init_process_group("nccl", timeout=_LONGEST_WAIT, device_id=where)
            else:
                dist.init_process_group("gloo", timeout=_LONGEST_WAIT)
        yield Processes(dist.get_rank(), count, where)
        dist.destroy_process_group()  # after an error it would wait for processes that are gone


def _own_device(name: str) -> torch.device:
    """Return the device of this process, of those that torchrun started on this machine."""
    here, number = int(os.environ["LOCAL_WORLD_SIZE"]), int(os.environ["LOCAL_RANK"])
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name != "cuda":
        device = resolve_device(name)
        if device.type == "cuda":
            raise ConfigError(
                f"Device '{name}' is one GPU, and every process needs its own: use --device cuda."
            )
        return device
    if torch.cuda.is_available() and here > torch.cuda.device_count():
        raise ConfigError(
            f"This machine has {torch.cuda.device_count()} CUDA device(s) for {here} processes: start as many as "
            "there are with --nproc-per-node, or use --device cpu."
        )
    return resolve_device(f"cuda:{number}")


@contextlib.contextmanager
def _noticing_ends() -> Iterator[None]:
    """Turn what PyTorch says when another process is gone, in many ways, into our own error."""
    try:
        yield
    except torch.OutOfMemoryError:
        raise
    except RuntimeError as error:
        raise ResourceError(LOST) from error

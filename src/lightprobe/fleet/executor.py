"""How tasks are handed to machines: what a task needs, what comes back, and who runs it."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from lightprobe.core.errors import ConfigError

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Needs:
    """What one task takes of the machine that it runs on, and how often it may be tried."""

    cpus: float = 1.0
    """Cores; a task computes on as many threads."""
    gpus: float = 0.0
    """GPUs; a part lets several tasks share one, and 0 computes on the CPU."""
    memory: float = 2.0
    """GiB that are kept free for it."""
    retries: int = 3
    """How often a task is started again after its process or machine has died."""

    def __post_init__(self) -> None:
        """Refuse what no machine could give."""
        if not self.cpus > 0 or not self.gpus >= 0 or not self.memory > 0:
            raise ConfigError(
                "A task needs --needs.cpus and --needs.memory above 0, and --needs.gpus of at least 0."
            )
        if self.gpus > 1 and self.gpus != int(self.gpus):
            raise ConfigError(f"--needs.gpus {self.gpus:g}: above one GPU only whole ones can be had.")
        if self.retries < 0:
            raise ConfigError(f"--needs.retries must be at least 0, not {self.retries}.")

    @property
    def threads(self) -> int:
        """Threads that a task computes on."""
        return max(1, int(self.cpus))

    @property
    def device(self) -> str:
        """Where a task computes."""
        return "cuda" if self.gpus > 0 else "cpu"


@dataclass(frozen=True)
class Outcome(Generic[Task, Result]):
    """What became of a task."""

    task: Task
    result: Result | None
    lost: str | None = (
        None  # why there is no result: its process or machine died more often than it may be tried
    )


class Executor(Protocol):
    """Runs tasks somewhere."""

    def run(
        self, function: Callable[[Task], Result], tasks: Iterable[Task], needs: Needs
    ) -> Iterator[Outcome[Task, Result]]:
        """Yield the outcome of `function` on each task as tasks finish; they are drawn as needed."""
        ...

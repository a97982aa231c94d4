"""Progress with the time left, on standard error: a bar in a terminal, now and then a line elsewhere."""

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from lightprobe.runs.progress import clock

_QUIET_SECONDS = 10.0  # between two lines where there is no terminal


class Meter:
    """Shows how far each stage of a command is; a context manager. Nothing is on the screen before the first update."""

    def __init__(self) -> None:
        console = Console(stderr=True)
        self._bar: Progress | None = None
        if console.is_terminal:
            columns = (
                TextColumn("{task.description:<16}"), BarColumn(), MofNCompleteColumn(),
                TimeRemainingColumn(), TextColumn("{task.fields[note]}"),
            )  # fmt: skip
            self._bar = Progress(*columns, console=console)
        self._tasks: dict[str, TaskID] = {}
        self._started: dict[str, tuple[float, int]] = {}
        self._spoken = time.monotonic()

    def __enter__(self) -> "Meter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar and self._tasks:
            self._bar.stop()

    def update(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Report that `done` of `total` steps of `stage` are finished."""
        if self._bar:
            self._bar.start()  # more than once does no harm
            if stage not in self._tasks:
                self._tasks[stage] = self._bar.add_task(stage, total=total, completed=max(done - 1, 0), note=note)
            self._bar.update(self._tasks[stage], completed=done, total=total, note=note)
            return
        now = time.monotonic()
        start, first = self._started.setdefault(stage, (now, done))
        if done == total or now - self._spoken >= _QUIET_SECONDS:
            self._spoken = now
            left = (now - start) / max(done - first, 1) * (total - done)
            print(f"{stage}: {done} of {total}, {clock(left)} left {note}".rstrip(), file=sys.stderr, flush=True)

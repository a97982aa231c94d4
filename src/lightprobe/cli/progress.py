"""Progress with the time left, on standard error: bars in a terminal, elsewhere now and then a line.

with lightprobe.Meter() as meter:
    lightprobe.train("photos/cup", "runs/cup", on_progress=meter.update)
"""

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING

from lightprobe.runs.progress import clock

if TYPE_CHECKING:  # rich takes a tenth of a second to load, and a command that shows no progress goes without
    from rich.progress import TaskID

_QUIET_SECONDS = 10.0  # between two lines where there is no terminal


class Meter:
    """Shows how far each stage of the work is; a context manager. Nothing is shown before the first update."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(stderr=True)
        columns = (
            TextColumn("{task.description:<16}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
        )
        self._bar = Progress(*columns, console=console) if console.is_terminal else None
        self._bars: dict[str, TaskID] = {}
        self._begun: dict[
            str, tuple[float, int]
        ] = {}  # stage -> when it was first heard of, and at which step
        self._spoken = time.monotonic()

    def __enter__(self) -> "Meter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None and self._bars:
            self._bar.stop()

    def update(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Report that `done` of `total` steps of `stage` are finished."""
        if self._bar is None:
            self._say(stage, done, total, note)
            return
        self._bar.start()  # more than once does no harm
        if stage not in self._bars:
            self._bars[stage] = self._bar.add_task(stage, total=total, completed=max(done - 1, 0), note=note)
        self._bar.update(self._bars[stage], completed=done, total=total, note=note)

    def _say(self, stage: str, done: int, total: int, note: str) -> None:
        """Print a line, unless one has been printed shortly before."""
        now = time.monotonic()
        start, first = self._begun.setdefault(stage, (now, done))
        left = "" if done == first < total else clock((now - start) / max(done - first, 1) * (total - done))
        if done == total or time.monotonic() - self._spoken >= _QUIET_SECONDS:
            self._spoken = time.monotonic()
            words = f"{stage}: {done} of {total}{left and f', {left} left'} {note}"
            print(words.rstrip(), file=sys.stderr, flush=True)

"""Progress with the time left: a bar in a terminal, one in a notebook's cell, now and then a line elsewhere.

    with lightprobe.Meter() as meter:
        lightprobe.train("photos/cup", "runs/cup", on_progress=meter.update)

A terminal and lines are on standard error.
"""

import html
import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

from lightprobe.runs.progress import clock

if TYPE_CHECKING:  # rich takes a tenth of a second to load, and a command that shows no progress goes without
    from rich.console import Console
    from rich.progress import TaskID

_QUIET_SECONDS = 10.0  # between two lines where there is no terminal
_CELL_SECONDS = 0.25  # between two changes of a notebook's cell, which costs a message each


class _Display(Protocol):
    """One way to show progress."""

    def update(self, stage: str, done: int, total: int, note: str) -> None: ...

    def close(self) -> None: ...


class Meter:
    """Shows how far each stage of the work is; a context manager. Nothing is shown before the first update."""

    def __init__(self) -> None:
        from rich.console import Console

        console, notebook = Console(stderr=True), _notebook()
        self._display: _Display = (
            _Cell(notebook) if notebook is not None else _Bar(console) if console.is_terminal else _Lines()
        )

    def __enter__(self) -> "Meter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._display.close()

    def update(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Report that `done` of `total` steps of `stage` are finished."""
        self._display.update(stage, done, total, note)


class _Bar:
    """Bars of a terminal, one for each stage."""

    def __init__(self, console: "Console") -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (
            TextColumn("{task.description:<16}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
        )
        self._bar = Progress(*columns, console=console)
        self._tasks: dict[str, TaskID] = {}

    def update(self, stage: str, done: int, total: int, note: str) -> None:
        self._bar.start()  # more than once does no harm
        if stage not in self._tasks:
            self._tasks[stage] = self._bar.add_task(stage, total=total, completed=max(done - 1, 0), note=note)
        self._bar.update(self._tasks[stage], completed=done, total=total, note=note)

    def close(self) -> None:
        if self._tasks:
            self._bar.stop()


class _Clock:
    """Says how long each stage will still take, from the steps since it was first heard of; nothing before."""

    def __init__(self) -> None:
        self._started: dict[str, tuple[float, int]] = {}

    def left(self, stage: str, done: int, total: int) -> str:
        now = time.monotonic()
        start, first = self._started.setdefault(stage, (now, done))
        if done == first < total:
            return ""
        return f", {clock((now - start) / max(done - first, 1) * (total - done))} left"


class _Lines:
    """A line now and then, for logs."""

    def __init__(self) -> None:
        self._clock = _Clock()
        self._spoken = time.monotonic()

    def update(self, stage: str, done: int, total: int, note: str) -> None:
        left = self._clock.left(stage, done, total)
        if done == total or time.monotonic() - self._spoken >= _QUIET_SECONDS:
            self._spoken = time.monotonic()
            print(f"{stage}: {done} of {total}{left} {note}".rstrip(), file=sys.stderr, flush=True)

    def close(self) -> None: ...


class _Cell:
    """Bars under a notebook's cell, changed in place."""

    def __init__(self, notebook: Any) -> None:
        self._notebook = notebook  # the module IPython.display
        self._clock = _Clock()
        self._lines: dict[str, str] = {}
        self._handle: Any = None
        self._shown = 0.0

    def update(self, stage: str, done: int, total: int, note: str) -> None:
        words = f"{done} of {total}{self._clock.left(stage, done, total)} {note}".rstrip()
        bar = f'<progress value="{done}" max="{total}"></progress>'
        self._lines[stage] = f"<div>{html.escape(stage)} {bar} {html.escape(words)}</div>"
        if done == total or time.monotonic() - self._shown >= _CELL_SECONDS:
            self.close()

    def close(self) -> None:
        """Show the newest state."""
        if not self._lines:
            return
        self._shown = time.monotonic()
        shown = self._notebook.HTML("".join(self._lines.values()))
        if self._handle is None:
            self._handle = self._notebook.display(shown, display_id=True)
        else:
            self._handle.update(shown)


def _notebook() -> Any:
    """Return the module IPython.display in a notebook, and None elsewhere: a notebook's kernel has loaded it."""
    python = sys.modules.get("IPython")
    shell = python.get_ipython() if python is not None else None
    if shell is None or "IPKernelApp" not in shell.config:
        return None
    import IPython.display as notebook  # type: ignore[import-not-found, unused-ignore]

    return notebook

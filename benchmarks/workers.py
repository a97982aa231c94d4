"""Work in processes side by side, into a folder that holds work of one kind, so that a second call can go on.

Each process has one thread, so that several of them do not wait for each other.
"""

import contextlib
import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, TypeVar

from lightprobe.core.errors import ConfigError
from lightprobe.core.files import read_json, write_json

Result = TypeVar("Result")
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive", "NUMBA_NUM_THREADS": "1"}


def check_jobs(jobs: int) -> None:
    """Raise `ConfigError` for a number of processes that can do no work."""
    if jobs < 1:
        raise ConfigError(f"--jobs {jobs} is too few; give 1 or more.")


def begin(folder: Path, settings: dict[str, Any], others: str) -> None:
    """Note in a folder, which is made, with what settings it is filled; raise `ConfigError` where it holds `others`."""
    kept = folder / "settings.json"
    if kept.exists() and read_json(kept) != settings:
        raise ConfigError(f"{folder} holds {others}; name a new folder.")
    folder.mkdir(parents=True, exist_ok=True)
    write_json(kept, settings)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Let processes that start meanwhile use one thread; this one's libraries would refuse to change theirs later."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def side_by_side(
    function: Callable[..., Result], calls: Iterable[tuple[Any, ...]], jobs: int
) -> Iterator[Result]:
    """Yield what `function` returns for the arguments of each call, the first that is done first.

    function: of a module's top level. Every call has a process of its own, at most `jobs` at a time.
    """
    spawn = multiprocessing.get_context("spawn")
    with _one_thread(), ProcessPoolExecutor(jobs, spawn, max_tasks_per_child=1) as pool:
        for future in as_completed([pool.submit(function, *call) for call in calls]):
            yield future.result()

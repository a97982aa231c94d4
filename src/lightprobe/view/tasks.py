"""Work that takes seconds, done by a process of its own, so that the page stays alive; results are kept a while.

The process keeps what it has loaded. It may be killed or run out of memory: the task at hand then fails with a
sentence, and the next one gets a new process.
"""

import secrets
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.web.pool import Pool, Task, TaskState
from lightprobe.web.worker import WorkerProcess

_WAITING = 8  # tasks that may wait
_KEPT = 60  # finished tasks whose files are kept; the oldest go first


class TaskKind(StrEnum):
    """What the worker can do, see `view.worker`."""

    PREDICT = "predict"
    INSERT = "insert"
    PREVIEW = "preview"
    LOAD = "load"
    """Only what the first prediction of a run would wait for."""
    CORRECT = "correct"
    """A correction of one mask, taken up by all masks of its scene."""


DEADLINES = dict.fromkeys((TaskKind.PREVIEW, TaskKind.LOAD, TaskKind.CORRECT), 300.0)
DEADLINES |= dict.fromkeys((TaskKind.PREDICT, TaskKind.INSERT), 600.0)
"""Seconds after which a task is stopped; the first of a run also loads it."""


@dataclass(eq=False, kw_only=True)
class PageTask(Task):
    """A task of the page, and the files that it leaves."""

    id: str
    kind: TaskKind
    title: str
    folder: Path
    started: float = field(default_factory=time.time)

    @property
    def result(self) -> dict[str, Any]:
        """What came of it, nothing before it is done."""
        return self.answer.result() if self.state is TaskState.DONE else {}

    def file(self, name: str) -> Path:
        """Return one of its files; raise `InputError` for a name that it has not told."""
        if name not in {entry["name"] for entry in self.result.get("files", [])}:
            raise InputError("This result has no file of that name.")
        return self.folder / name

    def to_json(self) -> dict[str, Any]:
        """Return what the page is told."""
        state = self.state
        return {
            "id": self.id,
            "kind": self.kind,
            "title": self.title,
            "state": state,
            "stage": self.stage,
            "sentence": str(self.answer.exception()) if state is TaskState.FAILED else "",
            "result": self.result,
            "began": self.started,
            "about": {key: self.request[key] for key in ("run_index", "photo_task") if key in self.request},
        }


class Tasks:
    """The tasks of a page since its start, and the pool with one slot that does them."""

    def __init__(self, folder: Path, new_process: Callable[[int], WorkerProcess]):
        """Keep files in `folder`; `new_process` starts a worker."""
        self._folder, self._lock = folder, threading.Lock()
        self._kept: dict[str, PageTask] = {}
        self.pool = Pool(new_process, limit=_WAITING, lazy=True)

    def submit(self, kind: TaskKind, title: str, request: dict[str, Any]) -> PageTask:
        """Return a new task that waits for its turn; raise `RefusedError` (429) when too many do."""
        id = secrets.token_urlsafe(9)
        folder = self._folder / id
        asked = {**request, "task": kind.value, "folder": str(folder)}
        about: dict[str, Any] = {"id": id, "kind": kind, "title": title, "folder": folder}
        task = PageTask(request=asked, seconds=DEADLINES[kind], waiting_counts=False, **about)
        with self._lock:
            self.pool.check_room()
            folder.mkdir(parents=True)
            self._kept[id] = task
            self._forget_oldest()
            self.pool.submit(task)
        return task

    def get(self, id: str) -> PageTask:
        """Return a task; raise `InputError` when there is none of this name any more."""
        with self._lock:
            task = self._kept.get(id)
        if task is None:
            raise InputError("This result is no longer kept here; start it again.")
        return task

    def all(self) -> list[PageTask]:
        """Return the tasks that are kept, the oldest first."""
        with self._lock:
            return list(self._kept.values())

    @property
    def busy(self) -> bool:
        """Whether a task waits or runs."""
        return any(not task.answer.done() for task in self.all())

    def _forget_oldest(self) -> None:
        over = [task for task in self._kept.values() if task.answer.done()]
        for task in over[: max(len(over) - _KEPT, 0)]:
            del self._kept[task.id]
            shutil.rmtree(task.folder, ignore_errors=True)

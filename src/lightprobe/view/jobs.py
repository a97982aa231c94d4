"""Work that takes seconds, one piece after the other in a process of its own, so that the page stays alive.

The process keeps what it has loaded. It may be killed or run out of memory: the job at hand then fails with a
sentence and the next one gets a new process. A job that takes too long is stopped the same way.
"""

import queue
import secrets
import shutil
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError, LightprobeError, ResourceError
from lightprobe.service.errors import WorkerEndedError
from lightprobe.service.worker_process import WorkerProcess

_WAITING = 8  # jobs that may wait
_KEPT = 60  # finished jobs whose files are kept; the oldest go first


class JobState(StrEnum):
    """How far a job is."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


class TaskName(StrEnum):
    """What the worker can do, see `view.worker`."""

    PREDICT = "predict"
    INSERT = "insert"
    FORMING = "forming"
    LOAD = "load"
    """Only what the first prediction of a run would wait for."""


DEADLINES = {TaskName.PREDICT: 600.0, TaskName.INSERT: 600.0, TaskName.FORMING: 300.0, TaskName.LOAD: 300.0}
"""Seconds after which a job is stopped; the first of a run also loads it."""


_CLOSED = "The page is being closed."


@dataclass
class Job:
    """A piece of work, its files and what came of it."""

    id: str
    task: TaskName
    title: str
    request: dict[str, Any]
    folder: Path
    state: JobState = JobState.WAITING
    stage: str = ""
    sentence: str = ""  # why it failed
    result: dict[str, Any] = field(default_factory=dict)
    began: float = field(default_factory=time.time)

    def file(self, name: str) -> Path:
        """Return one of its files; raise `InputError` for a name that it has not told."""
        names = {entry["name"] for entry in self.result.get("files", [])}
        if name not in names:
            raise InputError("This result has no file of that name.")
        return self.folder / name

    def to_json(self) -> dict[str, Any]:
        """Return what the page is told."""
        return {
            "id": self.id,
            "task": self.task,
            "title": self.title,
            "state": self.state,
            "stage": self.stage,
            "sentence": self.sentence,
            "result": self.result,
            "began": self.began,
            "about": {key: self.request[key] for key in ("run_index", "photo_job") if key in self.request},
        }


class Jobs:
    """All jobs since the start, and the thread that hands them to the worker."""

    def __init__(self, folder: Path, command: Sequence[str]):
        """Keep files in `folder`; `command` starts a worker."""
        self._folder, self._command = folder, command
        self._jobs: dict[str, Job] = {}
        self._lock = threading.Lock()
        self._queue: queue.Queue[Job | None] = queue.Queue()
        self._worker: WorkerProcess | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._serve, name="lightprobe-jobs", daemon=True)
        self._thread.start()

    def submit(self, task: TaskName, title: str, request: dict[str, Any]) -> Job:
        """Return a new job that waits for its turn; raise `ResourceError` when too many do."""
        id = secrets.token_urlsafe(9)
        folder = self._folder / id
        with self._lock:
            if sum(job.state is JobState.WAITING for job in self._jobs.values()) >= _WAITING:
                raise ResourceError(
                    "Too much is waiting to be computed already; try again when some of it is done."
                )
            folder.mkdir(parents=True)
            job = self._jobs[id] = Job(id, task, title, {**request, "folder": str(folder)}, folder)
            self._forget_oldest()
        self._queue.put(job)
        return job

    def get(self, id: str) -> Job:
        """Return a job; raise `InputError` when there is none of this name any more."""
        with self._lock:
            job = self._jobs.get(id)
        if job is None:
            raise InputError("This result is no longer kept here; start it again.")
        return job

    def all(self) -> list[Job]:
        """Return the jobs that are kept, the oldest first."""
        with self._lock:
            return list(self._jobs.values())

    def cancel(self, id: str) -> None:
        """Stop a job that waits or runs; one that is over stays as it is."""
        job = self.get(id)
        with self._lock:
            running = job.state is JobState.RUNNING
            if running or job.state is JobState.WAITING:
                job.state, job.sentence = JobState.FAILED, "It was stopped."
            worker = self._worker
        if running and worker is not None:
            worker.kill()

    def close(self) -> None:
        """End the worker and its thread; what waits is not begun."""
        with self._lock:
            self._closed, worker = True, self._worker
            for job in self._jobs.values():
                if job.state is JobState.WAITING:
                    job.state, job.sentence = JobState.FAILED, _CLOSED
        self._queue.put(None)
        if worker is not None:
            worker.kill()
        self._thread.join(timeout=5)

    @property
    def worker_pid(self) -> int | None:
        """The process that computes, None before the first job."""
        with self._lock:
            return None if self._worker is None else self._worker.pid

    def _forget_oldest(self) -> None:
        over = [job for job in self._jobs.values() if job.state in (JobState.DONE, JobState.FAILED)]
        for job in over[: max(len(over) - _KEPT, 0)]:
            del self._jobs[job.id]
            shutil.rmtree(job.folder, ignore_errors=True)

    def _serve(self) -> None:
        while (job := self._queue.get()) is not None:
            with self._lock:
                if job.state is not JobState.WAITING:
                    continue
                job.state = JobState.RUNNING
            try:
                result = self._ask(job)
            except LightprobeError as error:
                self._end(job, JobState.FAILED, sentence=str(error))
            except Exception as error:  # whatever it is, the next job must get its turn
                self._end(
                    job, JobState.FAILED, sentence=f"This failed in an unexpected way ({error}); try again."
                )
            else:
                self._end(job, JobState.DONE, result=result)

    def _end(self, job: Job, state: JobState, **changes: Any) -> None:
        with self._lock:
            if job.state is JobState.RUNNING:
                job.state = state
                for key, value in changes.items():
                    setattr(job, key, value)

    def _ask(self, job: Job) -> dict[str, Any]:
        """Return the worker's answer; raise `LightprobeError` with its sentence, or one about its end."""
        limit, late = DEADLINES[job.task], threading.Event()
        with self._lock:
            if self._closed:
                raise ResourceError(_CLOSED)
            if self._worker is None or not self._worker.alive:
                self._worker = WorkerProcess(self._command)
            worker = self._worker

        def stop() -> None:
            late.set()
            worker.kill()

        timer = threading.Timer(limit, stop)
        timer.start()
        try:
            return worker.ask(
                {"task": job.task.value, **job.request}, lambda stage: setattr(job, "stage", stage)
            )
        except WorkerEndedError as error:
            if late.is_set():
                raise ResourceError(
                    f"This took longer than {limit:.0f} seconds and was stopped; try a smaller photo."
                ) from error
            raise
        finally:
            timer.cancel()

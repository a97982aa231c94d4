"""One worker of the pool: its process, what it keeps loaded, and why it was ended."""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from lightprobe.core.memory import resident_bytes
from lightprobe.service.devices import Assignment
from lightprobe.service.worker_process import WorkerProcess

START = {"task": "start"}
"""What a new process is asked first: its answer says that it can be used."""


class SlotState(StrEnum):
    """What a worker is doing."""

    STARTING = "starting"
    IDLE = "idle"
    BUSY = "busy"


class End(StrEnum):
    """Why a worker's process has ended."""

    DIED = "died"
    """By itself, or somebody else has ended it."""
    DEADLINE = "deadline"
    """Its request took too long."""
    MEMORY = "memory"
    """It took more memory than a worker may, in the middle of a request."""
    RETIRED = "retired"
    """The same after a request."""


@dataclass(frozen=True)
class SlotSettings:
    """What all workers have in common."""

    command: Callable[[Assignment], Sequence[str]]
    memory: int  # bytes that a process may take
    on_text: Callable[[int, str], None]  # worker and a line that it writes to standard error


@dataclass(eq=False)
class WorkerSlot:
    """A worker: a process, replaced whenever it ends."""

    number: int
    assignment: Assignment
    settings: SlotSettings
    state: SlotState = SlotState.STARTING
    objects: frozenset[str] = frozenset()  # that it keeps loaded
    idle_since: float = field(default_factory=time.monotonic)
    told: dict[str, Any] = field(default_factory=dict)  # what it has said of itself last
    _process: WorkerProcess | None = None
    _ended: End | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def pid(self) -> int | None:
        """The number of its process, None while there is none."""
        process = self._process
        return None if process is None else process.pid

    @property
    def alive(self) -> bool:
        """Whether there is a process that can be asked."""
        process = self._process
        return process is not None and process.alive

    @property
    def resident(self) -> int | None:
        """The bytes that its process takes, None where that cannot be told."""
        pid = self.pid
        return None if pid is None else resident_bytes(pid)

    @property
    def too_large(self) -> bool:
        """Whether its process takes more memory than it may."""
        return (self.resident or 0) > self.settings.memory

    def start(self) -> None:
        """Start a process and wait until it can be used; raises `LightprobeError` when it cannot."""
        settings, number = self.settings, self.number
        process = WorkerProcess(
            settings.command(self.assignment),
            environment=self.assignment.environment,
            on_text=lambda text: settings.on_text(number, text),
        )
        with self._lock:
            self._process, self._ended, self.objects, self.told = process, None, frozenset(), {}
        process.ask(START, lambda stage: None)

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the process's answer; raises what it tells, or `WorkerEndedError`."""
        process = self._process
        if process is None:
            raise ValueError("Started first.")
        answer = process.ask(request, lambda stage: None)
        self.told = answer.pop("worker", {})
        self.objects = frozenset(self.told.get("objects", ()))
        return answer

    def end(self, reason: End) -> None:
        """End its process, for a reason that `ended` tells."""
        with self._lock:
            if self._ended is None:
                self._ended = reason
            if self._process is not None:
                self._process.kill()

    def ended(self) -> End:
        """Return why its process has ended."""
        return self._ended or End.DIED

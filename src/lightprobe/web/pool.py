"""Worker processes, one or several, that share a bounded queue of tasks, each task with a deadline.

A task that is not finished in time ends its process, which is replaced; so does one that takes too much memory.
A task whose process died by itself goes to the front of the queue again, unless it may be tried only once. Of the
tasks that wait, a process takes the oldest, or a younger one whose object the process has loaded, as long as the
oldest has not been passed over too often.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from lightprobe.core.errors import LightprobeError, ResourceError
from lightprobe.core.memory import resident_bytes
from lightprobe.web.errors import RefusedError, WorkerEndedError, reported
from lightprobe.web.worker import START, WorkerProcess

_TICK = 0.05  # seconds between two looks at deadlines
_MEMORY_TICKS = 5  # of these between two looks at memory
_PASSED = 8  # times that younger tasks may go first
_LONGEST_PAUSE = 30.0  # seconds between two starts of a process that does not come up
_STOPPING = "The server is being stopped; try again, elsewhere or later."


class TaskState(StrEnum):
    """How far a task is."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


@dataclass(eq=False, kw_only=True)
class Task:
    """A request to a worker process that was accepted."""

    request: dict[str, Any]
    seconds: float  # that it may take
    waiting_counts: bool = True  # whether from its acceptance on, else from its begin
    object: str = ""  # that it needs loaded
    accepted: float = field(default_factory=time.monotonic)
    begun: float | None = None
    slot: int | None = None  # number of the slot that works on it
    tries: int = 0
    passed: int = 0
    stage: str = ""  # what its process has told last
    answer: Future[dict[str, Any]] = field(default_factory=Future)

    @property
    def state(self) -> TaskState:
        """How far it is."""
        if not self.answer.done():
            return TaskState.WAITING if self.begun is None else TaskState.RUNNING
        return TaskState.DONE if self.answer.exception() is None else TaskState.FAILED

    @property
    def late(self) -> bool:
        """Whether its deadline is over."""
        begin = self.accepted if self.waiting_counts else self.begun
        return begin is not None and time.monotonic() > begin + self.seconds

    @property
    def waited(self) -> float:
        """Seconds until a process took it, the last time if two did."""
        return (self.begun or time.monotonic()) - self.accepted

    def fail(self, error: LightprobeError) -> None:
        """End it with an error, unless it has ended or its client has gone."""
        with contextlib.suppress(InvalidStateError):
            self.answer.set_exception(error)

    def succeed(self, result: dict[str, Any]) -> None:
        """End it with a result, unless it has ended or its client has gone."""
        with contextlib.suppress(InvalidStateError):
            self.answer.set_result(result)


class SlotState(StrEnum):
    """What a slot's process is doing."""

    STARTING = "starting"
    IDLE = "idle"
    BUSY = "busy"


class End(StrEnum):
    """Why a slot's process has ended."""

    DIED = "died"
    """By itself, or somebody else has ended it."""
    DEADLINE = "deadline"
    """Its task took too long."""
    MEMORY = "memory"
    """It took more memory than it may, in the middle of a task."""
    RETIRED = "retired"
    """The same after a task."""
    STOPPED = "stopped"
    """Nobody wants the result of its task any more."""


class Event(StrEnum):
    """What a pool tells of its processes."""

    STARTED = "worker started"
    FAILED = "worker failed to start"
    ENDED = "worker ended"
    RETRIED = "request tried again"


@dataclass(eq=False)
class Slot:
    """The place of a worker process, which is replaced whenever it ends."""

    number: int
    state: SlotState = SlotState.STARTING
    process: WorkerProcess | None = None
    objects: frozenset[str] = frozenset()  # that the process keeps loaded
    told: dict[str, Any] = field(default_factory=dict)  # what the process has said of itself last
    end_reason: End = End.DIED

    @property
    def alive(self) -> bool:
        """Whether there is a process that can be asked."""
        process = self.process
        return process is not None and process.alive

    @property
    def resident(self) -> int:
        """The bytes that the process takes, 0 where that cannot be told."""
        process = self.process
        return 0 if process is None else resident_bytes(process.pid) or 0

    def start(self, process: WorkerProcess) -> None:
        """Take a new process and wait until it can be asked; raises `LightprobeError` when it cannot."""
        self.process, self.end_reason = process, End.DIED
        self.objects, self.told = frozenset(), {}
        process.ask(START, lambda stage: None)

    def ask(self, task: Task) -> dict[str, Any]:
        """Return the process's answer; raises the error that it tells, or `WorkerEndedError`."""
        if self.process is None:
            raise ValueError("Started first.")
        answer = self.process.ask(task.request, lambda stage: setattr(task, "stage", stage))
        self.told = answer.pop("worker", {})
        self.objects = frozenset(self.told.get("objects", ()))
        return answer

    def end(self, reason: End) -> None:
        """End the process, for a reason that counts if it is the first."""
        if self.end_reason is End.DIED:
            self.end_reason = reason
        if self.process is not None:
            self.process.kill()


class Pool:
    """The slots and the tasks that wait for them."""

    def __init__(
        self,
        new_process: Callable[[int], WorkerProcess],
        *,
        limit: int,
        slots: int = 1,
        memory: float = float("inf"),
        tries: int = 1,
        lazy: bool = False,
        note: Callable[..., None] = lambda event, **values: None,
    ):
        """Start the process of each slot, which `new_process` makes for the slot's number.

        limit: tasks that may wait. memory: bytes that a process may take. tries: of a task whose process dies.
        lazy: a process is started when a task is there. note: takes each `Event` with what belongs to it.
        """
        self.limit, self._tries, self._lazy, self._note = limit, tries, lazy, note
        self._waiting: deque[Task] = deque()
        self._changed = threading.Condition()
        self._running: dict[Slot, Task] = {}
        self._closed = False
        self._new_process, self._memory = new_process, memory
        self.slots = [Slot(number) for number in range(slots)]
        works = [threading.Thread(target=self._work, args=(slot,), daemon=True) for slot in self.slots]
        self._threads = [*works, threading.Thread(target=self._watch, daemon=True)]
        for thread in self._threads:
            thread.start()

    # ---- what an application asks for

    @property
    def waiting(self) -> int:
        """How many tasks wait."""
        return len(self._waiting)

    @property
    def ready(self) -> bool:
        """Whether a process can take tasks."""
        return not self._closed and any(slot.state is not SlotState.STARTING for slot in self.slots)

    def check_room(self) -> None:
        """Raise `RefusedError` (429) when no more tasks may wait, `ResourceError` when all is being stopped."""
        if self._closed:
            raise ResourceError(_STOPPING)
        if len(self._waiting) >= self.limit:
            raise RefusedError(
                429, f"{self.limit} requests wait already, and no more are taken; try again later."
            )

    def submit(self, task: Task) -> None:
        """Let a task wait for a process; raises as `check_room`."""
        with self._changed:
            self.check_room()
            self._waiting.append(task)
            self._changed.notify_all()

    def drop(self, task: Task) -> bool:
        """Forget a task whose client has gone; return whether it still waited, and so will not be begun."""
        with self._changed:
            if task not in self._waiting:
                return False
            self._waiting.remove(task)
            return True

    def stop(self, task: Task) -> None:
        """End a task that waits or runs; one that is over stays as it is."""
        with self._changed:
            task.fail(ResourceError("It was stopped."))
            if not self.drop(task):
                for slot in [slot for slot, one in self._running.items() if one is task]:
                    slot.end(End.STOPPED)

    def close(self) -> None:
        """Take no more tasks, fail those that still wait, and end the processes."""
        with self._changed:
            self._closed = True
            for task in self._waiting:
                task.fail(ResourceError(_STOPPING))
            self._waiting.clear()
            self._changed.notify_all()
        for slot in self.slots:
            slot.end(End.RETIRED)
        for thread in self._threads:
            thread.join(timeout=5)

    # ---- a thread for each slot

    def _work(self, slot: Slot) -> None:
        failures = 0
        while self._wanted():
            try:
                slot.start(self._new_process(slot.number))
            except LightprobeError as error:
                if not self._closed:
                    failures += 1
                    self._note(Event.FAILED, worker=slot.number, sentence=str(error))
                    self._give_up(error, failures)
                continue
            failures = 0
            self._note(Event.STARTED, worker=slot.number, pid=slot.process and slot.process.pid)
            while (task := self._next(slot)) is not None:
                self._serve(slot, task)
            slot.state = SlotState.STARTING
            if not self._closed:
                self._note(Event.ENDED, worker=slot.number, reason=slot.end_reason.value)

    def _wanted(self) -> bool:
        """Return whether a process is to be started; where that is lazy, wait for a task first."""
        with self._changed:
            while self._lazy and not self._closed and not self._waiting:
                self._changed.wait()
            return not self._closed

    def _give_up(self, error: LightprobeError, failures: int) -> None:
        """Pause before another start, or where that is lazy, fail the task that has asked for it."""
        with self._changed:
            if self._lazy and self._waiting:
                self._waiting.popleft().fail(error)
            end = time.monotonic() + min(2.0 ** (failures - 1), _LONGEST_PAUSE)
            while not self._lazy and not self._closed and (left := end - time.monotonic()) > 0:
                self._changed.wait(left)

    def _serve(self, slot: Slot, task: Task) -> None:
        """Hand a task to a process, and its result, or why there is none, to whoever waits for it."""
        result: dict[str, Any] | LightprobeError
        try:
            result = slot.ask(task)
        except LightprobeError as told:
            result = told
        except Exception as unexpected:  # whatever it is, the client gets an answer and the slot goes on
            result = reported(unexpected)
        with self._changed:
            self._running.pop(slot)
            again = isinstance(result, WorkerEndedError) and self._again(slot, task)
            if again:
                self._waiting.appendleft(task)
            self._changed.notify_all()
        if again:
            self._note(Event.RETRIED, worker=slot.number)
        elif isinstance(result, LightprobeError):
            task.fail(self._reason(slot, task, result))
        else:
            task.succeed(result)
        if slot.resident > self._memory:
            slot.end(End.RETIRED)

    def _again(self, slot: Slot, task: Task) -> bool:
        by_chance = slot.end_reason in (End.DIED, End.RETIRED) and not self._closed
        return by_chance and task.tries < self._tries and not task.late

    @staticmethod
    def _reason(slot: Slot, task: Task, error: LightprobeError) -> LightprobeError:
        if not isinstance(error, WorkerEndedError):
            return error
        if slot.end_reason is End.DEADLINE or task.late:
            return _too_late(task)
        if slot.end_reason is End.MEMORY:
            return RefusedError(
                500, "This photo needs more memory than a worker may take; send a smaller one."
            )
        if task.tries == 1:
            return error
        return RefusedError(
            500, "Two workers ended while they worked on this request, so it is not tried again."
        )

    def _next(self, slot: Slot) -> Task | None:
        """Return the task that a process is to take, None once the process has ended or all is over."""
        with self._changed:
            slot.state = SlotState.IDLE
            self._changed.notify_all()
            while not self._closed and slot.alive:
                task = self._choice(slot)
                if task is not None:
                    slot.state, slot.objects = SlotState.BUSY, slot.objects | {task.object}
                    task.begun, task.slot, task.tries = time.monotonic(), slot.number, task.tries + 1
                    self._running[slot] = task
                    if self._waiting:  # another slot may have left the oldest task to this one
                        self._changed.notify_all()
                    return task
                self._changed.wait(10 * _TICK)  # no longer, for the process may end meanwhile
            return None

    def _choice(self, slot: Slot) -> Task | None:
        """Take the task for an idle process out of the queue; return None where it is for another slot."""
        if not self._waiting:
            return None
        oldest = chosen = self._waiting[0]
        if oldest.object not in slot.objects:
            idle = [one for one in self.slots if one.state is SlotState.IDLE and one.alive]
            if any(oldest.object in one.objects for one in idle):
                return None  # it goes to one of these
            if oldest.passed < _PASSED:
                chosen = next((task for task in self._waiting if task.object in slot.objects), oldest)
        oldest.passed += chosen is not oldest
        self._waiting.remove(chosen)
        return chosen

    # ---- one thread that looks at deadlines and memory

    def _watch(self) -> None:
        tick = 0
        while not self._closed:
            time.sleep(_TICK)
            tick += 1
            with self._changed:
                for task in [task for task in self._waiting if task.late]:
                    self._waiting.remove(task)
                    task.fail(_too_late(task))
                for slot, task in self._running.items():
                    if task.late:
                        slot.end(End.DEADLINE)
                    elif tick % _MEMORY_TICKS == 0 and slot.resident > self._memory:
                        slot.end(End.MEMORY)


def _too_late(task: Task) -> RefusedError:
    work = "was still waiting" if task.begun is None else "was not finished"
    return RefusedError(
        504,
        f"The request {work} after {task.seconds:.3g} s and was given up; send a smaller photo, or try again later.",
    )

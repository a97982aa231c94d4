"""Workers that share a bounded queue of requests, each request with a deadline.

A request that cannot be finished in time ends its worker, which is replaced; so does one that takes too much
memory. A request whose worker died by itself goes to the front of the queue once more. Of the requests that
wait, a worker takes the oldest, or a younger one whose object it has loaded, as long as the oldest has not
been passed over too often.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, InvalidStateError
from dataclasses import dataclass, field
from typing import Any

from lightprobe.core.errors import LightprobeError, ResourceError
from lightprobe.service.devices import Assignment
from lightprobe.service.errors import BusyError, DeadlineError, WorkerEndedError, WorkerLostError, reported
from lightprobe.service.slot import End, SlotSettings, SlotState, WorkerSlot
from lightprobe.service.telemetry import Telemetry

_TICK = 0.05  # seconds between two looks at deadlines
_MEMORY_TICKS = 5  # of these between two looks at memory
_TRIES = 2  # of a request whose worker dies
_PASSED = 8  # times that younger requests may go first
_LONGEST_PAUSE = 30.0  # seconds between two starts of a worker that does not come up
_WEIGHT = 0.1  # of the newest request in the mean time of one
_STOPPING = "The service is being stopped; try again, elsewhere or later."


@dataclass(eq=False)
class Task:
    """A request that was accepted."""

    request: dict[str, Any]
    object: str
    seconds: float  # from its acceptance to its deadline
    accepted: float = field(default_factory=time.monotonic)
    answer: Future[dict[str, Any]] = field(default_factory=Future)
    tries: int = 0
    passed: int = 0
    begun: float | None = None
    worker: int | None = None

    @property
    def late(self) -> bool:
        """Whether its deadline is over."""
        return time.monotonic() > self.accepted + self.seconds

    @property
    def waited(self) -> float:
        """Seconds until a worker took it, the last time if it did twice."""
        return (self.begun or time.monotonic()) - self.accepted

    def fail(self, error: LightprobeError) -> None:
        """End it with an error, unless it has ended or its client has gone."""
        with contextlib.suppress(InvalidStateError):
            self.answer.set_exception(error)

    def succeed(self, result: dict[str, Any]) -> None:
        """End it with a result, unless it has ended or its client has gone."""
        with contextlib.suppress(InvalidStateError):
            self.answer.set_result(result)


class Pool:
    """The workers and the requests that wait for them."""

    def __init__(
        self, workers: Sequence[Assignment], settings: SlotSettings, limit: int, telemetry: Telemetry
    ):
        """Start all workers; at most `limit` requests wait."""
        self.limit, self._telemetry = limit, telemetry
        self._waiting: deque[Task] = deque()
        self._changed = threading.Condition()
        self._running: dict[WorkerSlot, Task] = {}
        self._closed = False
        self._mean = 1.0  # seconds of a request
        self.slots = [WorkerSlot(number, one, settings) for number, one in enumerate(workers)]
        self._threads = [
            threading.Thread(target=self._work, args=(slot,), daemon=True) for slot in self.slots
        ]
        self._threads.append(threading.Thread(target=self._watch, daemon=True))
        for thread in self._threads:
            thread.start()

    # ---- what the application asks for

    @property
    def waiting(self) -> int:
        """How many requests wait."""
        return len(self._waiting)

    @property
    def ready(self) -> bool:
        """Whether a worker can take requests."""
        return not self._closed and any(slot.state is not SlotState.STARTING for slot in self.slots)

    def check_room(self) -> None:
        """Raise `BusyError` when no more requests may wait, `ResourceError` when the service is being
        stopped.
        """
        if self._closed:
            raise ResourceError(_STOPPING)
        if len(self._waiting) >= self.limit:
            seconds = min(max(round(self._mean * len(self._waiting) / len(self.slots)), 1), 60)
            raise BusyError(
                f"{self.limit} requests wait already, and no more are taken; try again in {seconds} s.",
                seconds,
            )

    def submit(self, task: Task) -> None:
        """Let a request wait for a worker; raises as `check_room`."""
        with self._changed:
            self.check_room()
            self._waiting.append(task)
            self._changed.notify_all()

    def drop(self, task: Task) -> bool:
        """Forget a request whose client has gone; return whether it still waited, and so will not be begun."""
        with self._changed:
            if task not in self._waiting:
                return False
            self._waiting.remove(task)
            return True

    def close(self) -> None:
        """Take no more requests, refuse those that still wait, and end the workers.

        Those that were accepted have ended by then: the server waits for its answers first.
        """
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

    # ---- a thread for each worker

    def _work(self, slot: WorkerSlot) -> None:
        failures = 0
        while not self._closed:
            try:
                slot.start()
            except LightprobeError as error:
                if self._closed:
                    return
                failures += 1
                self._telemetry.worker_failed(slot, error)
                self._pause(min(2.0 ** (failures - 1), _LONGEST_PAUSE))
                continue
            failures = 0
            self._telemetry.worker_started(slot)
            self._serve(slot)
            slot.state = SlotState.STARTING
            if not self._closed:
                self._telemetry.worker_ended(slot, slot.ended())

    def _pause(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        with self._changed:
            while not self._closed and (left := end - time.monotonic()) > 0:
                self._changed.wait(left)

    def _serve(self, slot: WorkerSlot) -> None:
        """Hand requests to a worker until its process ends or all is over."""
        while (task := self._next(slot)) is not None:
            error, result = None, None
            try:
                result = slot.ask(task.request)
            except LightprobeError as told:
                error = told
            except (
                Exception
            ) as unexpected:  # whatever it is, the client gets an answer and the worker goes on
                error = reported(unexpected)
            with self._changed:
                self._running.pop(slot)
                again = isinstance(error, WorkerEndedError) and self._again(slot, task)
                if again:
                    self._waiting.appendleft(task)
                self._changed.notify_all()
            if again:
                self._telemetry.retried(slot)
            elif error is not None:
                task.fail(self._reason(slot, task, error))
            elif result is not None:
                self._mean += _WEIGHT * (time.monotonic() - (task.begun or task.accepted) - self._mean)
                task.succeed(result)
            if slot.too_large:
                slot.end(End.RETIRED)

    def _again(self, slot: WorkerSlot, task: Task) -> bool:
        return slot.ended() in (End.DIED, End.RETIRED) and task.tries < _TRIES and not task.late

    @staticmethod
    def _reason(slot: WorkerSlot, task: Task, error: LightprobeError) -> LightprobeError:
        if not isinstance(error, WorkerEndedError):
            return error
        if slot.ended() is End.DEADLINE or task.late:
            return _too_late(task)
        if slot.ended() is End.MEMORY:
            return WorkerLostError("This photo needs more memory than a worker may take; send a smaller one.")
        return WorkerLostError(
            "Two workers ended while they worked on this request, so it is not tried again."
        )

    def _next(self, slot: WorkerSlot) -> Task | None:
        """Return the request that a worker is to take, None once its process has ended or all is over."""
        with self._changed:
            slot.state, slot.idle_since = SlotState.IDLE, time.monotonic()
            self._changed.notify_all()
            while not self._closed and slot.alive:
                task = self._choice(slot)
                if task is not None:
                    slot.state, slot.objects = SlotState.BUSY, slot.objects | {task.object}
                    task.begun, task.worker, task.tries = time.monotonic(), slot.number, task.tries + 1
                    self._running[slot] = task
                    if self._waiting:  # another worker may have left the oldest request to this one
                        self._changed.notify_all()
                    return task
                self._changed.wait(10 * _TICK)  # no longer, for the process may end meanwhile
            return None

    def _choice(self, slot: WorkerSlot) -> Task | None:
        """Return the request for an idle worker and take it out of the queue, None if there is none or
        another's.
        """
        if not self._waiting:
            return None
        oldest = self._waiting[0]
        chosen: Task | None = oldest
        if oldest.object not in slot.objects:
            idle = [one for one in self.slots if one.state is SlotState.IDLE and one.alive]
            if any(oldest.object in one.objects for one in idle):
                chosen = None  # it goes to one of these
            elif oldest.passed < _PASSED:
                chosen = next((task for task in self._waiting if task.object in slot.objects), oldest)
        if chosen is None:
            return None
        if chosen is not oldest:
            oldest.passed += 1
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
                    elif tick % _MEMORY_TICKS == 0 and slot.too_large:
                        slot.end(End.MEMORY)


def _too_late(task: Task) -> DeadlineError:
    work = "was still waiting" if task.begun is None else "was not finished"
    return DeadlineError(
        f"The request {work} after {task.seconds:.3g} s and was given up; send a smaller photo, or try again later."
    )

"""What the service tells its operator: log lines as JSON, and counts for Prometheus.

A line has "time" (UTC), "level", "event" and what belongs to the event; never a header, a body or a query.
"""

import functools
import json
import logging
import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any, TextIO

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    disable_created_metrics,
    generate_latest,
)
from prometheus_client.exposition import CONTENT_TYPE_LATEST

from lightprobe.core.errors import printable
from lightprobe.web.pool import Event, Pool, Slot, SlotState

METRICS_TYPE = CONTENT_TYPE_LATEST
"""The media type of the metrics."""

# Bounds of the counts of seconds
_SECONDS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1, 1.5, 2, 3, 4, 6, 10, 20, 60, 300)
_LONGEST = 2000  # characters of a text in a log line


class JsonLines(logging.Handler):
    """Writes what is logged, our own events and other libraries' messages, as one JSON object a line."""

    def __init__(self, stream: TextIO | None = None):
        """Write to `stream`, by default to standard error."""
        super().__init__()
        self._stream = stream or sys.stderr
        self._writing = threading.Lock()

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line."""
        values = getattr(record, "values", None) or {"text": printable(record.getMessage())[:_LONGEST]}
        if record.exc_info and record.exc_info[1] is not None:
            values = {**values, "traceback": "".join(traceback.format_exception(record.exc_info[1]))}
        time = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = {
            "time": time,
            "level": record.levelname.lower(),
            "event": getattr(record, "event", "message"),
            **values,
        }
        try:
            with self._writing:
                self._stream.write(json.dumps(line, default=str) + "\n")
                self._stream.flush()
        except Exception:  # a log that cannot be written must not end a request
            self.handleError(record)


class Telemetry:
    """Log and counts of one service."""

    def __init__(self, logger: logging.Logger):
        """Log to `logger`."""
        disable_created_metrics()  # when each count began is of no use, and doubles what is sent
        self._logger, self._registry = logger, CollectorRegistry()
        names: dict[str, Any] = {"registry": self._registry, "namespace": "lightprobe"}
        timed: dict[str, Any] = {**names, "buckets": _SECONDS}
        self._names = names
        self.requests = Counter(
            "requests", "Answers, by route and HTTP status.", ["route", "status"], **names
        )
        words = "From the head of a request to its answer."
        self.seconds = Histogram("request_seconds", words, ["route"], **timed)
        self.waited = Histogram("waiting_seconds", "In the queue.", **timed)
        self.predicted = Histogram("prediction_seconds", "Of a worker on one photo.", ["method"], **timed)
        self.received = Counter("upload_bytes", "Bytes of photos that were accepted.", **names)
        self.uploads = Gauge("uploads", "Requests whose bodies are being received.", **names)
        self._ends = Counter("worker_ends", "Processes that ended, by reason.", ["reason"], **names)
        words = "Processes that could not be started."
        self._failures = Counter("worker_start_failures", words, **names)
        words = "Requests whose worker died and that were tried once more."
        self._retries = Counter("retries", words, **names)

    def watch(self, pool: Pool) -> None:
        """Show the state of a pool as it is whenever the metrics are asked for."""
        names = self._names
        Gauge("queue_length", "Requests that wait.", **names).set_function(lambda: pool.waiting)
        Gauge("queue_limit", "Requests that may wait.", **names).set(pool.limit)
        workers = Gauge("workers", "Workers by what they do.", ["state"], **names)
        for state in SlotState:
            workers.labels(state.value).set_function(functools.partial(_count, pool, state))
        for name, (words, value) in _OF_WORKERS.items():
            gauge = Gauge(name, words, ["worker"], **names)
            for slot in pool.slots:
                gauge.labels(str(slot.number)).set_function(functools.partial(value, slot))

    def metrics(self) -> bytes:
        """Return all counts in Prometheus' text format."""
        return generate_latest(self._registry)

    def total(self, sample: str) -> int:
        """Return the sum of all samples of this name."""
        found = (one for family in self._registry.collect() for one in family.samples)
        return round(sum(one.value for one in found if one.name == sample))

    def log(self, level: int, event: str, **values: Any) -> None:
        """Write a line."""
        self._logger.log(level, event, extra={"event": event, "values": values})

    def worker_event(self, event: Event, **values: Any) -> None:
        """Take note of what a pool tells of its processes."""
        if event is Event.FAILED:
            self._failures.inc()
        if event is Event.ENDED:
            self._ends.labels(values["reason"]).inc()
        if event is Event.RETRIED:
            self._retries.inc()
        self.log(_LEVELS.get(event, logging.WARNING), event.value, **values)

    def worker_said(self, number: int, text: str) -> None:
        """Take note of what a process writes to standard error."""
        self.log(logging.WARNING, "worker wrote", worker=number, text=text[:_LONGEST])


_LEVELS = {Event.STARTED: logging.INFO, Event.FAILED: logging.ERROR}

_OF_WORKERS: Mapping[str, tuple[str, Callable[[Slot], float]]] = {
    "worker_resident_bytes": ("Memory of a worker's process.", lambda slot: slot.resident),
    "loaded_objects": ("Objects that a worker keeps loaded.", lambda slot: len(slot.told.get("objects", ()))),
    "loaded_object_bytes": ("What these take.", lambda slot: slot.told.get("held", 0)),
    "object_loads": ("Objects loaded since the worker started.", lambda slot: slot.told.get("loads", 0)),
    "object_evictions": (
        "Objects let go for want of room since then.",
        lambda slot: slot.told.get("evictions", 0),
    ),
}


def _count(pool: Pool, state: SlotState) -> int:
    return sum(slot.state is state for slot in pool.slots)

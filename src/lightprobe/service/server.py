"""The service from start to end: where it listens, who may ask it, what computes, and what is removed."""

import contextlib
import logging
import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.extras import extra_library
from lightprobe.core.partial import partial_folder
from lightprobe.core.reading import check_file
from lightprobe.service.devices import CPU, Assignment, assignments
from lightprobe.web.listening import is_loopback, listening_socket, run_app, until_interrupted
from lightprobe.web.pool import Pool
from lightprobe.web.worker import WorkerProcess, worker_command

if TYPE_CHECKING:  # needs the extra
    from lightprobe.service.telemetry import Telemetry

PORT = 8422
"""Where the service is unless another port is asked for."""

GIB = 2**30
"""Bytes."""

_LARGEST_TOKEN = 4096  # bytes of a token's file
_SHORTEST_TOKEN = 16  # characters
_GRACE = 5.0  # seconds beyond the deadlines in which the last answers are sent when the service is stopped


class LogLevel(StrEnum):
    """What is logged."""

    DEBUG = "debug"
    """Everything, requests that only look included."""
    INFO = "info"
    """Predictions, refusals and what happens to workers."""
    WARNING = "warning"
    """Only what should not happen often."""


@dataclass(frozen=True)
class ServiceConfig:
    """Limits of a service."""

    deadline: float = 60.0
    """Seconds that a request may take, waiting included; then its worker is ended and replaced."""
    queue: int = 64
    """Requests that may wait; more are refused (429)."""
    uploads: int = 64
    """Photos that may be sent at the same time; more are refused (429)."""
    upload_seconds: float = 60.0
    """Seconds in which a photo must arrive."""
    max_megapixels: float = 64.0
    """Pixels of a photo or mask, in millions, beyond which it is refused before it is decoded."""
    cache_memory: float = 1.0
    """GiB that a worker's loaded objects may take; then the least recently used goes."""
    worker_memory: float = 6.0
    """GiB that a worker's process may take; then it is ended and replaced (on Linux)."""

    def __post_init__(self) -> None:
        """Refuse limits that no service could work with."""
        for name, value in vars(self).items():
            if not 0 < value < float("inf"):
                raise ConfigError(f"--{name.replace('_', '-')} must be above 0 and finite, not {value}.")


@dataclass(frozen=True)
class Served:
    """What a service has done when it has ended."""

    requests: int  # answers, refusals included
    predictions: int  # those with a map


def serve(
    folder: Path,
    *,
    host: str = "127.0.0.1",
    port: int = PORT,
    token: str | None = None,
    anyone: bool = False,
    devices: Sequence[str] = (),
    workers: int | None = None,
    config: ServiceConfig | None = None,
    log_level: LogLevel = LogLevel.INFO,
    tell: Callable[[str], None] = print,
) -> Served:
    """Serve predictions from the runs of a folder until a signal comes, and finish what was accepted by then.

    token: what requests must bring. anyone: others may ask without one. devices, workers: see
    `service.devices.assignments`. `tell` is given the address. Photos and maps lie in a temporary folder
    meanwhile. Raises `InputError` for a folder that is none, `ConfigError` for options that cannot be used or
    do not fit each other and without the extra `serve`, `ResourceError` for an address that cannot be used.
    """
    for library in ("fastapi", "uvicorn", "python_multipart", "prometheus_client"):
        extra_library(library, "The service", "serve")
    from lightprobe.service.app import create_app
    from lightprobe.service.objects import Objects
    from lightprobe.service.routes import Service
    from lightprobe.service.telemetry import Telemetry

    config = config or ServiceConfig()
    check_access(host, token, anyone=anyone)
    assigned = assignments(devices, workers)
    for one in assigned:
        resolve_device(one.device)
    known = Objects(folder)
    telemetry = Telemetry(logging.getLogger("lightprobe.service"))
    with (
        until_interrupted(),
        listening_socket(host, port) as listening,
        _logging(log_level),
        partial_folder(Path(tempfile.gettempdir())) as temporary,
    ):
        name = f"[{host}]" if ":" in host else host
        tell(
            f"Service: http://{name}:{listening.getsockname()[1]}/   ({_described(assigned)}; end with Ctrl-C)"
        )
        pool = _pool(folder, config, assigned, telemetry)
        telemetry.watch(pool)
        try:
            limits = (config.deadline, config.upload_seconds, config.uploads)
            service = Service(known, pool, telemetry, temporary, *limits)
            app = create_app(service, token, local=is_loopback(host) and not anyone)
            run_app(app, listening, grace=math.ceil(config.deadline + _GRACE), log_config=None)
        finally:
            pool.close()
    return Served(
        telemetry.total("lightprobe_requests_total"), telemetry.total("lightprobe_prediction_seconds_count")
    )


def _pool(runs: Path, config: ServiceConfig, assigned: Sequence[Assignment], telemetry: "Telemetry") -> Pool:
    def new_process(number: int) -> WorkerProcess:
        return WorkerProcess(
            worker_arguments(runs, config, assigned[number]),
            environment=assigned[number].environment,
            on_text=lambda text: telemetry.worker_said(number, text),
        )

    return Pool(
        new_process,
        slots=len(assigned),
        limit=config.queue,
        memory=config.worker_memory * GIB,
        tries=2,
        note=telemetry.worker_event,
    )


@contextlib.contextmanager
def _logging(level: LogLevel) -> Iterator[None]:
    """Let our own events and the messages of the HTTP server go to standard error as JSON lines meanwhile."""
    from lightprobe.service.telemetry import JsonLines

    loggers = {"lightprobe.service": level.upper(), "uvicorn": "WARNING"}
    handler = JsonLines()
    try:
        for name, lowest in loggers.items():
            logger = logging.getLogger(name)
            logger.setLevel(lowest)
            logger.propagate = False
            logger.addHandler(handler)
        yield
    finally:
        for name in loggers:
            logging.getLogger(name).removeHandler(handler)


def _described(assigned: Sequence[Assignment]) -> str:
    if all(one.device == CPU for one in assigned):
        return f"{len(assigned)} workers on the CPU, {assigned[0].threads} threads each"
    return "a worker on each of " + ", ".join(one.device for one in assigned)


def check_access(host: str, token: str | None, *, anyone: bool) -> None:
    """Raise `ConfigError` where a service would be open to others, or a token could be guessed.

    anyone: whether that is wanted.
    """
    if token is not None and (len(token) < _SHORTEST_TOKEN or not token.isascii() or not token.isprintable()):
        raise ConfigError(
            f"The token must have at least {_SHORTEST_TOKEN} printable characters; make one with: openssl rand -hex 32"
        )
    if token is None and not is_loopback(host) and not anyone:
        raise ConfigError(
            f"--host {host} can be reached by others, and there is no token; give one with --token-file or in "
            "LIGHTPROBE_TOKEN, or say --anyone where something else decides who gets there."
        )


def read_token(path: Path) -> str:
    """Return the token that a file holds, its first line; raise `InputError` where there is none."""
    check_file(path, _LARGEST_TOKEN)
    try:
        token = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read as text: {error}.") from error
    if not token or "\n" in token:
        raise InputError(
            f"{path} must hold the token in one line; make it with: openssl rand -hex 32 > {path}"
        )
    return token


def worker_arguments(runs: Path, config: ServiceConfig, assignment: Assignment) -> tuple[str, ...]:
    """Return the command of a worker for the objects of the folder `runs`, see `service.worker`."""
    numbers = (assignment.threads, round(config.cache_memory * GIB), round(config.max_megapixels * 1e6))
    return worker_command("lightprobe.service.worker", str(runs), assignment.device, *map(str, numbers))

"""The service and the page's server in this process, asked without a network, and what must be true of every
answer.
"""

import asyncio
import contextlib
import io
import json
import logging
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h11

from lightprobe.jobs import AnswerFiles, Output
from lightprobe.service.app import create_app as service_app
from lightprobe.service.objects import Objects
from lightprobe.service.routes import Service
from lightprobe.service.telemetry import JsonLines, Telemetry
from lightprobe.view.app import create_app as page_app
from lightprobe.view.routes import Session
from lightprobe.view.sources import Sources
from lightprobe.view.tasks import TaskKind
from lightprobe.web.errors import WorkerEndedError, received
from lightprobe.web.listening import server_settings
from lightprobe.web.pool import Pool, SlotState, TaskState
from lightprobe.web.worker import START
from tests.changes import changed_path
from tests.fuzz.connection import Answer, Watched, exchange
from tests.fuzz.worker import DefectError

ROOT = Path(__file__).parents[2]
TOKEN = "a-token-that-is-long-enough"
PAGE_HOST = "127.0.0.1:8421"
_LOGGERS = {
    "lightprobe.service": logging.DEBUG,
    "lightprobe.fuzz": logging.DEBUG,
    "uvicorn.error": logging.WARNING,
}
_ERRORS = {"fails": "InputError", "full": "ResourceError", "breaks": "UnexpectedError"}
_OUR_FAULT = {"InputError": 422, "ResourceError": 503, "UnexpectedError": 500}


class StandIn:
    """In the place of a process that computes: answers at once; what a photo is called says what becomes of it."""

    deaths = 0  # of all of them
    reasons: set[str] = set()  # noqa: RUF012  kinds of the errors that were told

    def __init__(self, number: int):
        """Stand in for the process of a slot."""
        self.pid, self.alive = os.getpid(), True

    def ask(self, request: dict[str, Any], on_stage: Callable[[str], None]) -> dict[str, Any]:
        """Return what a prediction would leave, or raise what one would."""
        request = json.loads(json.dumps(request))  # as it goes through a pipe
        if request == START or request["task"] == "load":
            return {"ready": True}
        on_stage("at work")
        what = str(request["name"]).partition(".")[0]
        if what == "dies" or (what == "once" and StandIn.deaths % 2 == 0):
            StandIn.deaths += 1
            self.kill()
            raise WorkerEndedError("The process has ended.")
        if what in _ERRORS:
            StandIn.reasons.add(_ERRORS[what])
            raise received("This cannot be done.", _ERRORS[what])
        folder = Path(request["folder"])
        if "outputs" not in request:  # the page's
            (folder / "light.exr").write_bytes(b"no map")
            return {"files": [{"name": "light.exr", "title": "light"}]}
        for path in (request["photo"], request["mask"], request["camera"]):
            if path is not None and not Path(path).resolve().is_relative_to(folder.resolve()):
                raise AssertionError("a file of a request outside its folder")
        paths = AnswerFiles.within(folder, map(Output, request["outputs"])).paths.values()
        for path in paths:
            path.write_bytes(b"map")
        told = {
            "method": request["method"] or "solve",
            "verdict": {"status": "good"},
            "pose": None,
            "warnings": [],
        }
        return {
            **told,
            "light": {"asked": request},
            "files": [path.name for path in paths],
            "seconds": {"all": 0.01},
        }

    def kill(self) -> None:
        """End it."""
        self.alive = False


class Writes:
    """Paths outside of some folders that this process changes while it is watched; the watch lasts for ever."""

    def __init__(self) -> None:
        """Begin to listen."""
        self._allowed: tuple[str, ...] = ()
        self.found: list[str] = []
        sys.addaudithook(self._heard)

    @contextlib.contextmanager
    def watched(self, *allowed: Path) -> Iterator[None]:
        """Note what is changed outside of these folders meanwhile."""
        self.found, self._allowed = [], tuple(f"{folder.resolve()}/" for folder in allowed)
        try:
            yield
        finally:
            self._allowed = ()

    def _heard(self, event: str, arguments: tuple) -> None:
        if self._allowed and (path := changed_path(event, arguments)) is not None:
            inside = f"{os.path.realpath(path)}/".startswith(self._allowed)
            if not inside and path != os.devnull and "__pycache__" not in path:  # modules load when needed
                self.found.append(path)


class Server:
    """An application behind the HTTP server's reading of bytes, and what it writes where."""

    def __init__(self, app: Callable, folders: tuple[Path, ...], writes: Writes):
        """Ask `app`, which may write into `folders`."""
        self._settings = server_settings(Watched(app))
        self._folders, self._writes = folders, writes

    def ask(self, loop: asyncio.AbstractEventLoop, data: bytes) -> list[Answer]:
        """Return the whole answers to requests in `data`; raise `DefectError` for what is wrong whatever was asked."""
        log = io.StringIO()
        for name, level in _LOGGERS.items():
            logger = logging.getLogger(name)
            logger.handlers, logger.propagate = [JsonLines(log)], False
            logger.setLevel(level)
        with self._writes.watched(*self._folders):
            answers, raw = loop.run_until_complete(exchange(self._settings, data))
        errors = [answer.error for answer in answers if answer.error is not None]
        # uvicorn's, where a body turns out to be damaged after the application has begun to answer
        ours = [error for error in errors if not isinstance(error, h11.LocalProtocolError)]
        if ours:
            raise DefectError("an error leaves the application", repr(ours[0])) from ours[0]
        for line in map(json.loads, log.getvalue().splitlines()):
            if "traceback" in line and not errors:
                raise DefectError("a traceback in the log", line["traceback"][-2000:])
        if self._writes.found:
            raise DefectError("a file outside of the folder", ", ".join(self._writes.found[:5]))
        if not answers and raw and b"Invalid HTTP request received." not in raw:
            raise DefectError("an answer without a request", repr(raw[:300]))
        return [
            answer for answer in answers if answer.status is not None and answer.ended and not answer.gone
        ]


def check_answer(answer: Answer, statuses: set[int], hidden: tuple[Path, ...]) -> None:
    """Raise `DefectError` unless the status is one of these, and a refusal JSON with one sentence.

    hidden: paths of this machine that no sentence may tell.
    """
    about = f"{answer.status} of {answer.method} {answer.path!r}: {bytes(answer.body[:500])!r}"
    if answer.status not in statuses:
        raise DefectError(f"the status {answer.status}", about)
    if answer.status < 400 or (answer.path, answer.status) == ("/ready", 503):
        return
    try:
        sentence = json.loads(answer.body)["sentence"]
    except (ValueError, TypeError, KeyError) as error:
        raise DefectError(f"no JSON in a {answer.status}", about) from error
    plain = sentence.isprintable() and sentence.endswith(".") and len(sentence) <= 1500
    if not plain or "Traceback" in sentence:
        raise DefectError(f"no sentence in a {answer.status}", about)
    if any(str(folder) in sentence for folder in hidden):
        raise DefectError("a path of the server in a sentence", about)


def documented_statuses() -> set[int]:
    """Return the statuses that docs/serve.md names."""
    text = (ROOT / "docs" / "serve.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d{3}(?:, \d{3})*) \|", text, re.M)
    return {int(status) for row in rows for status in row.split(", ")}


class ServiceServer:
    """The service with workers that compute nothing, once with a token and once without."""

    def __init__(self, runs: Path, writes: Writes):
        """Serve the objects of a folder."""
        folder = self._temporary = Path(tempfile.mkdtemp(dir=runs.parent))
        self._runs, self._documented = runs, documented_statuses() | {200}
        telemetry = Telemetry(logging.getLogger("lightprobe.service"))
        self.pool = Pool(StandIn, limit=8, tries=2, note=telemetry.worker_event)
        telemetry.watch(self.pool)
        self.service = Service(Objects(runs), self.pool, telemetry, folder, 5.0, 5.0, 4)
        apps = {token: service_app(self.service, token, local=True) for token in (None, TOKEN)}
        self._servers = {token: Server(app, (folder,), writes) for token, app in apps.items()}

    def ask(self, loop: asyncio.AbstractEventLoop, data: bytes, token: str | None) -> None:
        """Ask the requests in `data`; raise `DefectError` where an answer is not as it must be."""
        _until(lambda: self.pool.slots[0].state is SlotState.IDLE)
        StandIn.reasons, deaths, before = set(), StandIn.deaths, _listing(self._runs)
        answers = self._servers[token].ask(loop, data)
        faults = {_OUR_FAULT[reason] for reason in StandIn.reasons}
        if StandIn.deaths > deaths:
            faults |= {500, 503, 504}  # tried twice; not ready for a moment after it
        if b"deadline" in data:
            faults.add(504)
        statuses = {status for status in self._documented if status < 500} | faults
        for answer in answers:
            check_answer(answer, statuses, (self._temporary, self._runs))
            if "x-request-id" not in answer.headers:
                raise DefectError("an answer without its id", f"{answer.method} {answer.path!r}")
        if os.listdir(self._temporary) or self.service.receiving:
            raise DefectError("files of a request that is over", ", ".join(os.listdir(self._temporary)))
        if _listing(self._runs) != before:
            raise DefectError("a change of the runs", "a file has come or gone")


class PageServer:
    """The page's server with a worker that computes nothing, once with a token and once without."""

    statuses = frozenset({200, 303, 304, 307, 400, 401, 403, 404, 405, 413, 422, 429, 503})

    def __init__(self, root: Path, writes: Writes):
        """Show the run and the scene in a folder."""
        self._root, self._temporary = root, Path(tempfile.mkdtemp(dir=root))
        sources = Sources.of([root / "run", root / "photos"])
        session = Session.within(self._temporary, sources, StandIn)
        self.tasks, self._ids = session.tasks, {}
        apps = {token: page_app(session, frozenset({PAGE_HOST}), token) for token in (None, "a-token")}
        folders = (self._temporary, root / "photos")
        self._servers = {token: Server(app, folders, writes) for token, app in apps.items()}

    def ask(self, loop: asyncio.AbstractEventLoop, data: bytes, token: str | None) -> None:
        """Ask the requests in `data`; raise `DefectError` where an answer is not as it must be."""
        done = [
            one for one in self.tasks.all() if (one.kind, one.state) == (TaskKind.PREDICT, TaskState.DONE)
        ]
        ids = {b"TASK": done[-1].id if done else "none", **self._ids}
        for word in (b"TASK", b"LIGHT", b"OBJECT"):
            data = data.replace(word, ids.get(word, "none").encode())
        for answer in self._servers[token].ask(loop, data):
            check_answer(answer, set(self.statuses), (self._temporary, self._root))
            taken = {"/api/lights": b"LIGHT", "/api/objects": b"OBJECT"}.get(answer.path)
            if taken is not None and answer.status == 200:
                self._ids[taken] = json.loads(answer.body)["id"]
        _until(lambda: not self.tasks.busy)


def _listing(folder: Path) -> list[tuple[str, int]]:
    return sorted((path.name, path.stat().st_mtime_ns) for path in folder.rglob("*"))


def _until(true: Callable[[], bool]) -> None:
    while not true():  # a hang is found by who waits for the answer
        time.sleep(0.0005)


class Servers:
    """All servers of this process: made when the first request for them comes."""

    def __init__(self) -> None:
        """Make nothing yet."""
        self._made: dict[tuple[type, Path], ServiceServer | PageServer] = {}
        self._shared: tuple[asyncio.AbstractEventLoop, Writes] | None = None

    def ask(self, kind: type, folder: Path, data: bytes, token: str | None = None) -> None:
        """Ask the server of this kind for a folder."""
        if self._shared is None:
            self._shared = asyncio.new_event_loop(), Writes()
        loop, writes = self._shared
        if (kind, folder) not in self._made:
            self._made[kind, folder] = kind(folder, writes)
        self._made[kind, folder].ask(loop, data, token)


SERVERS = Servers()

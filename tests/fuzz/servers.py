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
from unittest import mock

from lightprobe.service.errors import STATUS
from lightprobe.service.pool import Pool
from lightprobe.service.running import server_settings
from lightprobe.service.slot import SlotSettings, SlotState
from lightprobe.view.jobs import Jobs, JobState, TaskName

from lightprobe.service import slot
from lightprobe.service.app import Service
from lightprobe.service.app import create_app as service_app
from lightprobe.service.devices import CPU, Assignment
from lightprobe.service.objects import Objects
from lightprobe.service.telemetry import JsonLines, Telemetry
from lightprobe.view import jobs
from lightprobe.view.app import Session
from lightprobe.view.app import create_app as page_app
from lightprobe.view.sources import Sources
from lightprobe.view.uploads import UploadKind, Uploads
from tests.changes import changed_path
from tests.fuzz.connection import Answer, Watched, exchange, quiet
from tests.fuzz.stand_ins import StandIn
from tests.fuzz.worker import DefectError

ROOT = Path(__file__).parents[2]
TOKEN = "a-token-that-is-long-enough"
PAGE_HOST = "127.0.0.1:8421"
_LOGGERS = ("lightprobe.service", "lightprobe.fuzz", "uvicorn.error")
_OUR_FAULT = {"InputError": 422, "ResourceError": 503, "UnexpectedError": 500}


def documented_statuses() -> set[int]:
    """Return the statuses that docs/serve.md names."""
    rows = re.findall(
        r"^\| (\d{3}(?:, \d{3})*) \|", (ROOT / "docs" / "serve.md").read_text(encoding="utf-8"), re.M
    )
    return {int(status) for row in rows for status in row.split(", ")}


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
            if (
                not inside and path != os.devnull and "__pycache__" not in path
            ):  # modules load when they are needed
                self.found.append(path)


class Server:
    """An application behind the HTTP server's reading of bytes, and what it writes where."""

    def __init__(self, app: Callable, folders: tuple[Path, ...], writes: Writes):
        """Ask `app`, which may write into `folders`."""
        self._settings = server_settings(app, grace=1, log_config=None)
        self._watched = Watched(self._settings.app)  # type: ignore[arg-type]
        self._settings.app = self._watched
        self._folders, self._writes = folders, writes
        self._log = io.StringIO()
        quiet(*_LOGGERS, handler=JsonLines(self._log))

    def ask(self, loop: asyncio.AbstractEventLoop, data: bytes) -> tuple[list[Answer], bytes]:
        """Return the answers to all requests in `data`; raise `DefectError` for what is wrong whatever was
        asked.
        """
        quiet(*_LOGGERS, handler=JsonLines(self._log))
        with self._writes.watched(*self._folders):
            answers, raw = loop.run_until_complete(exchange(self._settings, self._watched, data))
        for answer in answers:
            if answer.error is not None:
                self._check_log(raised=True)
                raise DefectError("an error leaves the application", repr(answer.error)) from answer.error
        self._check_log()
        if self._writes.found:
            raise DefectError("a file outside of the folder", ", ".join(self._writes.found[:5]))
        if not answers and raw and b"Invalid HTTP request received." not in raw:
            raise DefectError("an answer without a request", repr(raw[:300]))
        return [
            answer for answer in answers if answer.status is not None and answer.ended and not answer.gone
        ], raw

    def _check_log(self, *, raised: bool = False) -> None:
        """Empty the log; raise `DefectError` for a traceback in it that no error which was `raised` explains."""
        lines = self._log.getvalue().splitlines()
        self._log.seek(0)
        self._log.truncate()
        for line in lines:
            if "traceback" in json.loads(line) and not raised:
                raise DefectError("a traceback in the log", json.loads(line)["traceback"][-2000:])


def check_sentence(answer: Answer, hidden: tuple[Path, ...]) -> None:
    """Raise `DefectError` unless a refusal is JSON with one sentence, without the paths of this machine."""
    about = f"{answer.status} of {answer.method} {answer.path!r}: {bytes(answer.body[:500])!r}"
    try:
        told = json.loads(answer.body)
        sentence = told["sentence"]
    except (ValueError, TypeError, KeyError) as error:
        raise DefectError(f"no JSON in a {answer.status}", about) from error
    if (
        not sentence.isprintable()
        or not sentence.endswith(".")
        or len(sentence) > 1500
        or "Traceback" in sentence
    ):
        raise DefectError(f"no sentence in a {answer.status}", about)
    if any(str(folder) in sentence for folder in hidden):
        raise DefectError("a path of the server in a sentence", about)


class ServiceServer:
    """The service with workers that compute nothing, once with a token and once without."""

    def __init__(self, runs: Path, writes: Writes):
        """Serve the objects of a folder."""
        self._temporary = Path(tempfile.mkdtemp(dir=runs.parent))
        self._runs, self._documented = runs, documented_statuses() | {200}
        telemetry = Telemetry(logging.getLogger("lightprobe.service"))
        settings = SlotSettings(lambda assignment: (), 2**50, lambda number, text: None)
        self.pool = Pool([Assignment(CPU, 1)], settings, 8, telemetry)
        telemetry.watch(self.pool)
        self.service = Service(Objects(runs), self.pool, telemetry, self._temporary, 5.0, 5.0, 4)
        self._servers = {
            token: Server(service_app(self.service, token, local=True), (self._temporary,), writes)
            for token in (None, TOKEN)
        }

    def ask(self, loop: asyncio.AbstractEventLoop, data: bytes, token: str | None) -> list[Answer]:
        """Return the answers to the requests in `data`; raise `DefectError` where one is not as it must be."""
        _until(lambda: self.pool.slots[0].state is SlotState.IDLE)
        StandIn.reasons, deaths, before = set(), StandIn.deaths, _listing(self._runs)
        answers, _ = self._servers[token].ask(loop, data)
        allowed = {_OUR_FAULT[reason] for reason in StandIn.reasons}
        if StandIn.deaths > deaths:
            allowed |= {500, 503, 504}  # tried twice; not ready for a moment after it
        if b"deadline" in data:
            allowed.add(504)
        for answer in answers:
            self._check(answer, allowed)
        if os.listdir(self._temporary) or self.service.receiving:
            raise DefectError("files of a request that is over", ", ".join(os.listdir(self._temporary)))
        if _listing(self._runs) != before:
            raise DefectError("a change of the runs", "a file has come or gone")
        return answers

    def _check(self, answer: Answer, allowed: set[int]) -> None:
        if answer.status not in self._documented:
            raise DefectError(
                f"the status {answer.status}", f"{answer.method} {answer.path!r}, {answer.headers}"
            )
        if answer.status >= 500 and answer.status not in allowed:
            raise DefectError(
                f"the status {answer.status} without a reason", bytes(answer.body[:500]).decode()
            )
        if answer.status >= 400 and not (answer.path == "/ready" and answer.status == 503):
            check_sentence(answer, (self._temporary, self._runs))
        if "x-request-id" not in answer.headers and answer.status not in (401, 403):
            raise DefectError("an answer without its id", f"{answer.method} {answer.path!r}")


class PageServer:
    """The page's server with a worker that computes nothing, once with a token and once without."""

    def __init__(self, root: Path, writes: Writes):
        """Show the run and the scene in a folder."""
        self._temporary = Path(tempfile.mkdtemp(dir=root))
        self._root = root
        for part in ("uploads", "jobs", "pictures"):
            (self._temporary / part).mkdir()
        self.jobs, self.uploads = Jobs(self._temporary / "jobs", ()), Uploads(self._temporary / "uploads")
        sources = Sources.of([root / "run", root / "photos"])
        session = Session(sources, self.uploads, self.jobs, self._temporary / "pictures")
        apps = {token: page_app(session, frozenset({PAGE_HOST}), token) for token in (None, "a-token")}
        folders = (self._temporary, root / "photos")
        self._servers = {token: Server(app, folders, writes) for token, app in apps.items()}

    def ask(self, loop: asyncio.AbstractEventLoop, data: bytes, token: str | None) -> list[Answer]:
        """Return the answers to the requests in `data`; raise `DefectError` where one is not as it must be."""
        answers, _ = self._servers[token].ask(loop, self._with_ids(data))
        allowed = {200, 303, 304, 307, 400, 401, 403, 405, *STATUS.values()} - {500, 504}
        for answer in answers:
            if answer.status not in allowed:
                raise DefectError(
                    f"the status {answer.status}", f"{answer.method} {answer.path!r}, {answer.headers}"
                )
            if answer.status >= 400:
                check_sentence(answer, (self._temporary, self._root))
        _until(lambda: all(job.state not in (JobState.WAITING, JobState.RUNNING) for job in self.jobs.all()))
        return answers

    def _with_ids(self, data: bytes) -> bytes:
        done = [
            job.id for job in self.jobs.all() if job.task is TaskName.PREDICT and job.state is JobState.DONE
        ]
        named = {b"JOB": done[-1] if done else "none"}
        for word, kind in ((b"LIGHT", UploadKind.LIGHT), (b"THING", UploadKind.THING)):
            named[word] = next(reversed(self.uploads._files[kind]), "none")
        for word, id in named.items():
            data = data.replace(word, id.encode())
        return data


def _listing(folder: Path) -> list[tuple[str, int]]:
    return sorted((path.name, path.stat().st_mtime_ns) for path in folder.rglob("*"))


def _until(true: Callable[[], bool]) -> None:
    while not true():  # a hang is found by who waits for the answer
        time.sleep(0.0005)


class Servers:
    """All servers of this process: made when the first request for them comes."""

    def __init__(self) -> None:
        """Make nothing yet."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._writes: Writes | None = None
        self._made: dict[tuple[type, Path], ServiceServer | PageServer] = {}

    def ask(self, kind: type, folder: Path, data: bytes, token: str | None = None) -> list[Answer]:
        """Return the answers of the server of this kind for a folder."""
        if self._loop is None or self._writes is None:
            self._loop, self._writes = asyncio.new_event_loop(), Writes()
            for module in (slot, jobs):
                mock.patch.object(module, "WorkerProcess", StandIn).start()
        if (kind, folder) not in self._made:
            self._made[kind, folder] = kind(folder, self._writes)
        return self._made[kind, folder].ask(self._loop, data, token)


SERVERS = Servers()

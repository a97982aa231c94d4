"""A process that reads spoilt files under limits, and what came of each: nothing that it does can harm its
parent.
"""

import contextlib
import importlib
import multiprocessing
import os
import resource
import tempfile
import traceback
import warnings
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from lightprobe.core.errors import LightprobeError

MEMORY = 2 * 2**30  # bytes: resident at most, and address space beyond what the process has before it reads
SECONDS = 10.0  # a file may take; a hang is tried once more before it counts, as the machine may be busy
_START_SECONDS = 900.0  # for imports, compiled loops and the valid files


class DefectError(Exception):
    """What a target finds wrong without an error of the code that it attacks."""

    def __init__(self, kind: str, detail: str = ""):
        """Keep the kind, the same for the same defect, and what was seen."""
        super().__init__(f"{kind}: {detail}")
        self.kind = kind


@dataclass(frozen=True)
class Outcome:
    """What came of one file; `finding` is empty for a result or a sentence of ours."""

    finding: str = ""  # the same for the same defect: kind, and where
    detail: str = ""
    refused: bool = False
    memory: int = 0  # bytes, the largest resident size meanwhile


class Worker:
    """One process with its own copy of the corpus, started anew after it died."""

    def __init__(
        self,
        corpus: Path,
        source: str = "tests.fuzz.targets:TARGETS",
        only: frozenset[str] | None = None,
        seconds: float = SECONDS,
    ):
        """Read the files of `corpus` with the targets of MODULE:NAME, or `only` some, for `seconds` at most."""
        self._corpus, self._source, self._seconds = corpus, (source, only), seconds
        self._process: Any = None
        self._connection: Connection | None = None

    def read(self, target: str, file: str, data: bytes) -> Outcome:
        """Return what came of reading `data` in the place of a target's file."""
        found = self._once(target, file, data)
        return self._once(target, file, data) if found.finding.startswith("hang") else found

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process = None

    def _once(self, target: str, file: str, data: bytes) -> Outcome:
        if self._process is None:
            self._start()
        assert self._connection is not None
        try:
            self._connection.send((target, file, data))
            if not self._connection.poll(self._seconds):
                self.close()
                return Outcome(f"hang in {target}", f"more than {self._seconds:g} s")
            return self._connection.recv()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode
            self.close()
            return Outcome(f"death of the process in {target}", f"exit code {code}")

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(theirs, str(self._corpus), self._source), daemon=True
        )
        self._process.start()
        theirs.close()
        if not self._connection.poll(_START_SECONDS) or self._connection.recv() != "ready":
            raise RuntimeError("the process that reads has not become ready")


def _serve(connection: Connection, corpus: str, source: tuple[str, frozenset[str] | None]) -> None:
    """Read what comes through the connection until it is closed."""
    module, _, held = source[0].partition(":")
    every = getattr(importlib.import_module(module), held)
    found = [target for target in every if source[1] is None or target.name in source[1]]
    with tempfile.TemporaryDirectory() as folder:
        null = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):  # what libraries print is dropped, and core dumps
            os.dup2(null, stream)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        warnings.simplefilter("ignore")
        targets = {target.name: target for target in found}
        for target in found:
            target.copy(Path(corpus), Path(folder))
            for file in target.write(Path(corpus)):
                with contextlib.suppress(
                    Exception
                ):  # compiles what is compiled; __main__ checks that they are valid
                    target.read(Path(folder) / target.name, Path(folder) / target.name / file)
        limit = _status("VmSize") + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        connection.send("ready")
        while True:
            try:
                name, file, data = connection.recv()
            except EOFError:
                return
            root = Path(folder) / name
            sound = (root / file).read_bytes()
            (root / file).write_bytes(data)
            outcome = _outcome(targets[name], root, root / file)
            (root / file).write_bytes(sound)
            connection.send(outcome)


def _outcome(target: Any, root: Path, path: Path) -> Outcome:
    Path("/proc/self/clear_refs").write_text("5")  # the largest size so far is forgotten
    finding = detail = ""
    refused = False
    try:
        target.read(root, path)
    except LightprobeError as error:
        refused, detail = True, str(error)[:2000]
        if not (detail.isprintable() and detail.endswith(".") and len(detail) < 1500):
            finding = f"no sentence in {target.name}"
    except BaseException as error:
        detail = "".join(traceback.format_exception(error))[-4000:]
        kind = f"{error.kind} in" if isinstance(error, DefectError) else f"{type(error).__name__} in"
        finding = f"{kind} {target.name} at {_place(error)}"
    memory = _status("VmHWM")
    if not finding and memory > MEMORY:
        finding, detail = f"memory in {target.name}", f"{memory / 2**30:.2f} GiB"
    return Outcome(finding, detail, refused, memory)


def _place(error: BaseException) -> str:
    """Return the innermost line of ours that an error came through."""
    ours = [frame for frame in traceback.extract_tb(error.__traceback__) if "lightprobe" in frame.filename]
    return f"{Path(ours[-1].filename).name}:{ours[-1].name}" if ours else "no line of ours"


def _status(key: str) -> int:
    """Return a size of this process out of Linux' own record, bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line for line in lines if line.startswith(f"{key}:")).split()[1])

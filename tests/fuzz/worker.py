"""A process that reads spoilt files under limits, and what came of each: nothing that it does can harm its
parent.
"""

import contextlib
import importlib
import multiprocessing
import os
import resource
import sys
import tempfile
import time
import traceback
import warnings
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

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
        module: str = "tests.fuzz.targets",
        name: str = "TARGETS",
        only: frozenset[str] | None = None,
    ):
        """Read the files of `corpus` with the targets that a module holds under a name, or `only` some of
        them.
        """
        self._corpus, self._source = corpus, (module, name, only)
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
            if not self._connection.poll(SECONDS):
                self.close()
                return Outcome(f"hang in {target}", f"more than {SECONDS:g} s")
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


def _serve(connection: Connection, corpus: str, source: tuple[str, str, frozenset[str] | None]) -> None:
    """Read what comes through the connection until it is closed."""
    module, held, only = source
    found = [t for t in getattr(importlib.import_module(module), held) if only is None or t.name in only]
    with tempfile.TemporaryDirectory() as folder:
        _quiet()
        targets = {target.name: target for target in found}
        for target in found:
            target.copy(Path(corpus), Path(folder))
            for file in target.write(Path(corpus)):
                with contextlib.suppress(
                    Exception
                ):  # compiles what is compiled; __main__ checks that they are valid
                    target.read(Path(folder) / target.name, Path(folder) / target.name / file)
        _limit_memory()
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


def _quiet() -> None:
    """Drop what libraries print, and core dumps."""
    null = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(null, stream)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")


def _limit_memory() -> None:
    limit = _status("VmSize") + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def _outcome(target: Any, root: Path, path: Path) -> Outcome:
    from lightprobe.core.errors import LightprobeError

    Path("/proc/self/clear_refs").write_text("5")  # the largest size so far is forgotten
    finding = detail = ""
    refused = False
    began = time.monotonic()
    try:
        target.read(root, path)
    except LightprobeError as error:
        refused = True
        finding, detail = _no_sentence(target.name, str(error))
    except DefectError as error:
        finding, detail = f"{error.kind} in {target.name}", _trace(error)
    except MemoryError as error:
        finding, detail = f"MemoryError in {target.name} at {_place(error)}", _trace(error)
    except BaseException as error:
        finding, detail = f"{type(error).__name__} in {target.name} at {_place(error)}", _trace(error)
    memory = _status("VmHWM")
    if not finding and memory > MEMORY:
        finding, detail = f"memory in {target.name}", f"{memory / 2**30:.2f} GiB"
    return Outcome(finding, detail or f"{time.monotonic() - began:.2f} s", refused, memory)


def _no_sentence(target: str, message: str) -> tuple[str, str]:
    whole = message.isprintable() and message.endswith(".") and len(message) < 1500
    return ("", "") if whole else (f"no sentence in {target}", message[:2000])


def _place(error: BaseException) -> str:
    """Return the innermost line of ours that an error came through."""
    ours = [frame for frame in traceback.extract_tb(error.__traceback__) if "lightprobe" in frame.filename]
    return f"{Path(ours[-1].filename).name}:{ours[-1].name}" if ours else "no line of ours"


def _trace(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))[-4000:]


def _status(key: str) -> int:
    """Return a size of this process out of Linux' own record, bytes."""
    if not sys.platform.startswith("linux"):
        raise RuntimeError("fuzzing needs Linux, which tells how much memory a process has used")
    line = next(
        line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(f"{key}:")
    )
    return int(line.split()[1]) * 1024

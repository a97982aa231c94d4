"""The program in a process of its own, disturbed at its n-th change of the file system, or after some time."""

import contextlib
import errno
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from tests.changes import changed_path

_ENDLESS = 600.0  # seconds after which a command counts as hanging
BROKE_DOWN = 99  # exit status of a process in which something else than the program failed


class Fault(Enum):
    """What goes wrong at a moment."""

    NONE = "undisturbed"
    KILL = "kill -9"
    FULL = "disk full"
    LIMIT = "writes end"
    """Files end at a size, as on a disk that fills up while they are written."""
    READ_ONLY = "read-only folder"


@dataclass(frozen=True)
class Moment:
    """When and how a command is disturbed: at a change of the file system from 1 on, after seconds, or by size."""

    fault: Fault = Fault.NONE
    change: int = 0
    seconds: float = 0.0
    size: int = 0  # bytes

    def __str__(self) -> str:
        """Return it in words."""
        at = f"change {self.change}" if self.change else f"{self.seconds:.2f} s" if self.seconds else ""
        at = f"{self.size} bytes" if self.size else at
        return f"{self.fault.value}{f' at {at}' if at else ''}"


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int  # negative: the signal
    said: str  # on standard error
    changes: int  # of the file system, in the folder that it works in
    seconds: float


def start(words: Sequence[str], folder: Path, moment: Moment) -> Callable[[], Ended]:
    """Run `lightprobe` in a child of this process, which has loaded it; return what waits for its end.

    folder: where changes count. Nothing must run in other threads of this process.
    """
    # Pipes, as a file would end at the same size as those of the program.
    noted, counted = os.pipe(), os.pipe()
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        _child(words, folder, moment, noted[1], counted[1])
    if moment.fault is Fault.KILL and not moment.change:
        time.sleep(moment.seconds)
        os.kill(child, signal.SIGKILL)

    def wait() -> Ended:
        code = _awaited(child, began)
        said, changes = (_drained(*pipe) for pipe in (noted, counted))
        return Ended(code, said.decode(errors="replace"), len(changes), time.monotonic() - began)

    return wait


def in_child(work: Callable[[], None]) -> None:
    """Do `work` in a child: what has used OpenMP's threads cannot be forked any more."""
    child = os.fork()
    if child == 0:
        try:
            work()
        except BaseException:
            traceback.print_exc()
            os._exit(BROKE_DOWN)
        os._exit(0)
    if _awaited(child, time.monotonic()) != 0:
        raise RuntimeError("the inputs could not be made")


def _drained(reader: int, writer: int) -> bytes:
    """Return what was written into a pipe, and close it; a process that lives on may hold its other end."""
    os.close(writer)
    os.set_blocking(reader, False)
    parts = []
    with contextlib.suppress(BlockingIOError):
        while part := os.read(reader, 1 << 16):
            parts.append(part)
    os.close(reader)
    return b"".join(parts)


def _awaited(child: int, began: float) -> int:
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() - began > _ENDLESS:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.01)


def _child(words: Sequence[str], folder: Path, moment: Moment, noted: int, counted: int) -> None:
    """Be the program, and never return."""
    code = BROKE_DOWN
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(noted, 2)
        from lightprobe.cli.main import main

        if moment.size:
            resource.setrlimit(resource.RLIMIT_FSIZE, (moment.size, moment.size))
        sys.addaudithook(_Disturbance(folder, moment, counted))
        code = main(list(words))
        sys.stderr.flush()
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


class _Disturbance:
    """Counts changes of the file system in a folder, and does what the moment asks at one of them, or from it on."""

    def __init__(self, folder: Path, moment: Moment, counter: int):
        self._folder, self._moment, self._counter, self._count = str(folder.resolve()), moment, counter, 0

    def __call__(self, event: str, arguments: tuple) -> None:
        path = changed_path(event, arguments)
        if path is None or not path.startswith(self._folder):
            return
        self._count += 1
        os.write(self._counter, b".")
        if not self._moment.change or self._count < self._moment.change:
            return
        if self._moment.fault is Fault.KILL:
            os.kill(os.getpid(), signal.SIGKILL)
        removes = event in ("os.remove", "os.rmdir")
        if self._moment.fault is Fault.FULL and not removes:  # a full disk lets files be removed
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(arguments[0]))
        if self._moment.fault is Fault.READ_ONLY:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(arguments[0]))

"""Temporary files and folders, and how leftovers of killed processes are told from them and cleared away.

Each is locked (flock) for as long as its writer lives and has a name that nobody else gives. What has such a
name and no lock is a leftover. Where there are no locks nothing is cleared, as its writer may be alive.
"""

import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment, unused-ignore]

PARTIAL = ".partial-"  # within a run folder, where all files are ours
_PREFIX = f"{PARTIAL}lightprobe-"
_OURS = re.compile(re.escape(_PREFIX) + r"[a-z0-9_]{8}(\..*)?")


def partial_file(folder: Path, suffix: str) -> contextlib.AbstractContextManager[Path]:
    """Clear leftovers out of `folder` and yield a new empty file in it, deleted at the end if still there."""

    def make() -> Path:
        handle, name = tempfile.mkstemp(dir=folder, prefix=_PREFIX, suffix=suffix)
        os.close(handle)
        return Path(name)

    return _locked(folder, make)


def partial_folder(parent: Path) -> contextlib.AbstractContextManager[Path]:
    """Clear leftovers out of `parent` and yield a new empty folder in it, deleted at the end if still there."""
    return _locked(parent, lambda: Path(tempfile.mkdtemp(dir=parent, prefix=_PREFIX)))


def clear_leftovers(folder: Path) -> None:
    """Delete what killed processes of this program have left in `folder`; what is not theirs stays."""
    found = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        found = [Path(entry.path) for entry in entries if _OURS.fullmatch(entry.name)]
    _clear(found, unlockable=False)


def clear_run(folder: Path) -> None:
    """Delete all leftovers in a run folder that the caller has locked, also where files cannot be locked."""
    _clear(folder.rglob(f"{PARTIAL}*"), unlockable=True)


@contextlib.contextmanager
def _locked(folder: Path, make: Callable[[], Path]) -> Iterator[Path]:
    """Yield what `make` makes in `folder`; made again if another process clears it away before it is locked."""
    clear_leftovers(folder)
    while True:
        path, handle = make(), None
        try:
            handle = _lock(path)
        except (BlockingIOError, FileNotFoundError):
            continue
        except OSError:  # there are no locks here
            break
        if path.exists():
            break
        os.close(handle)
    try:
        yield path
    finally:
        _delete(path)
        if handle is not None:
            os.close(handle)


def _clear(paths: Iterable[Path], *, unlockable: bool) -> None:
    """Delete the leftovers among `paths`; `unlockable`: also those that cannot be locked."""
    for path in list(paths):
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            continue
        handle = None
        try:
            handle = _lock(path)
        except BlockingIOError:  # its writer lives
            continue
        except OSError:
            if not unlockable:
                continue
        _delete(path)
        if handle is not None:
            os.close(handle)


def _lock(path: Path) -> int:
    """Return a handle of a file or folder that holds its lock until it is closed.

    Raises `BlockingIOError` when another process holds the lock, another `OSError` when it cannot be locked.
    """
    if fcntl is None:
        raise OSError("This system has no locks.")
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        raise
    return handle


def _delete(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)

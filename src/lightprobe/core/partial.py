"""Temporary files and folders that a killed process leaves behind: how they are told from others, and cleared
away.

Each is locked for as long as its writer lives and has a name that nobody else gives. What has such a name and
no lock is a leftover. Where there are no locks nothing is cleared, as its writer may be alive.
"""

import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from lightprobe.core.locks import Lock, try_lock

PARTIAL = ".partial-"  # within a run folder, where all files are ours
_PREFIX = f"{PARTIAL}lightprobe-"
_OURS = re.compile(re.escape(_PREFIX) + r"[a-z0-9_]{8}(\..*)?")


@contextlib.contextmanager
def partial_file(folder: Path, suffix: str) -> Iterator[Path]:
    """Clear leftovers out of `folder` and yield a new empty file in it, deleted at the end if it is still
    there.
    """
    clear_leftovers(folder)
    handle, path = _made(lambda: _new_file(folder, suffix))
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)
        _close(handle)


@contextlib.contextmanager
def partial_folder(parent: Path) -> Iterator[Path]:
    """Clear leftovers out of `parent` and yield a new empty folder in it, deleted at the end if it is still
    there.
    """
    clear_leftovers(parent)
    handle, path = _made(lambda: _new_folder(parent))
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        _close(handle)


def clear_leftovers(folder: Path) -> None:
    """Delete what killed processes of this program have left in `folder`; what is not theirs stays."""
    found = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        found = [Path(entry.path) for entry in entries if _OURS.fullmatch(entry.name)]
    _clear(found, unlockable=False)


def clear_run(folder: Path) -> None:
    """Delete all leftovers in a run folder that the caller has locked, also where single files cannot be
    locked.
    """
    _clear(list(folder.rglob(f"{PARTIAL}*")), unlockable=True)


def _clear(paths: Iterable[Path], *, unlockable: bool) -> None:
    """Delete the leftovers among `paths`; `unlockable`: also those whose writers cannot be asked after."""
    for path in paths:
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            continue
        with contextlib.suppress(OSError), _opened(path) as handle:
            lock = Lock.UNKNOWN if handle is None else try_lock(handle)
            if lock is Lock.HELD or (lock is Lock.UNKNOWN and unlockable):
                shutil.rmtree(path) if path.is_dir() else path.unlink()


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[int | None]:
    handle = (
        _open_folder(path) if path.is_dir() else os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    )
    try:
        yield handle
    finally:
        _close(handle)


def _made(make: Callable[[], tuple[int | None, Path]]) -> tuple[int | None, Path]:
    """Return what `make` makes, with the handle that locks it; None where nothing can be locked.

    Until it is locked another process may take it for a leftover: then it is made again.
    """
    while True:
        handle, path = make()
        lock = Lock.UNKNOWN if handle is None else try_lock(handle)
        if lock is Lock.UNKNOWN:  # an open file could not be renamed on Windows
            _close(handle)
            return None, path
        if lock is Lock.HELD and path.exists():
            return handle, path
        _close(handle)


def _new_file(folder: Path, suffix: str) -> tuple[int, Path]:
    handle, name = tempfile.mkstemp(dir=folder, prefix=_PREFIX, suffix=suffix)
    return handle, Path(name)


def _new_folder(parent: Path) -> tuple[int | None, Path]:
    while True:
        path = Path(tempfile.mkdtemp(dir=parent, prefix=_PREFIX))
        with contextlib.suppress(FileNotFoundError):
            return _open_folder(path), path


def _open_folder(path: Path) -> int | None:
    """Return a handle of a folder, or None on Windows, which opens none."""
    return None if os.name == "nt" else os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)


def _close(handle: int | None) -> None:
    if handle is not None:
        os.close(handle)

"""A file that one process at a time holds."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from lightprobe.core.errors import BusyError
from lightprobe.core.files import disk_errors
from lightprobe.core.locks import Lock, is_at, try_lock


@contextlib.contextmanager
def locked_file(path: Path, busy: str) -> Iterator[None]:
    """Hold the file at `path`, made when there is none, locked; raise `BusyError` saying `busy` if another
    does.
    """
    for last in (False, False, True):
        with disk_errors(path):
            handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
        with open(handle, "a"):
            lock = try_lock(handle)
            if lock is Lock.HELD and not last and not is_at(handle, path):
                continue  # its last holder has just removed it
            if lock is Lock.BUSY:
                raise BusyError(busy)
            yield
            return

"""Advisory locks, which die with the process that holds them."""

import errno
import os
from enum import Enum


class Lock(Enum):
    """What came of trying to lock a file."""

    HELD = "held"
    BUSY = "busy"
    """Another process holds it."""
    UNKNOWN = "unknown"
    """The system or the file system has no locks."""


def try_lock(handle: int) -> Lock:
    """Lock an open file or folder without waiting; the lock lasts until every copy of the handle is closed."""
    try:
        import fcntl
    except ImportError:  # Windows
        return Lock.UNKNOWN
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return Lock.BUSY if error.errno in (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES) else Lock.UNKNOWN
    return Lock.HELD


def is_at(handle: int, path: str | os.PathLike[str]) -> bool:
    """Return whether an open file is still the one at `path`: between opening and locking it may have been
    replaced.
    """
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path, follow_symlinks=False))
    except OSError:
        return False

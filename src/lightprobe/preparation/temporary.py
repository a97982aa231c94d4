"""A folder for COLMAP's database: it works on files, and ends the process where the disk is full."""

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from lightprobe.core.errors import ResourceError
from lightprobe.core.partial import partial_folder

_BESIDE = 64 << 20  # bytes that are to be free beside what is asked for


@contextlib.contextmanager
def working_folder(needed: int) -> Iterator[Path]:
    """Yield a new folder in the system's temporary one, deleted at the end.

    needed: bytes that will be written there. Raises `ResourceError` where so much is not free.
    """
    parent = Path(tempfile.gettempdir())
    free = shutil.disk_usage(parent).free
    if free < needed + _BESIDE:
        raise ResourceError(
            f"{parent} has {free >> 20} MB free, finding cameras needs {(needed + _BESIDE) >> 20} MB there; free some, "
            "or name another folder in the environment variable TMPDIR."
        )
    with partial_folder(parent) as folder:
        yield folder

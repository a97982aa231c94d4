"""Which files are opened at all: regular ones of a sane size.

A pipe never ends, a device has no end, and a file of hundreds of gigabytes is no photo: reading them hangs or
takes all memory, so a file is looked at before it is opened.
"""

import io
import json
import os
import stat
from pathlib import Path

from lightprobe.core.errors import InputError

LARGEST_PICTURE = 2**31 + 2**20  # bytes: the most pixels that are decoded, as 32-bit RGBA, and a header
LARGEST_VIDEO = 2**37  # bytes: an hour of what cameras write at their best
LARGEST_TEXT = 2**28  # bytes of JSON or poses: some 500 000 cameras
LARGEST_MODEL = 2**32  # bytes of a file of a COLMAP model, which also lists every observed point

_KINDS = (
    (stat.S_ISDIR, "folder"),
    (stat.S_ISFIFO, "pipe"),
    (stat.S_ISSOCK, "socket"),
    (stat.S_ISCHR, "device"),
    (stat.S_ISBLK, "device"),
)


class BoundedFile(io.BufferedReader):
    """A file open for reading that is asked for no more bytes than it has left.

    Python makes room for as many as are asked for before it reads, and decoders ask for what a header
    announces.
    """

    def __init__(self, path: Path):
        super().__init__(io.FileIO(path))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1) -> bytes:
        """Return up to `size` bytes, all that are left without one."""
        left = max(self._size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))


def check_file(path: Path, largest: int) -> None:
    """Raise `InputError` unless `path` is a regular file of at most `largest` bytes; it is not opened."""
    try:
        found = os.stat(path)
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist.") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    if not stat.S_ISREG(found.st_mode):
        kind = next((name for is_kind, name in _KINDS if is_kind(found.st_mode)), "special file")
        raise InputError(f"{path} cannot be read: it is a {kind}, not a regular file; name the file itself.")
    if found.st_size > largest:
        raise InputError(
            f"{path} has {found.st_size / 1e9:.1f} GB, more than the {largest / 1e9:.1f} GB that are read of such a "
            "file; check that it is the right one."
        )


def decode_text(content: bytes) -> str:
    """Return the text of a file in UTF-8, UTF-16 or UTF-32, without its byte order mark, if it has one.

    Raises `UnicodeDecodeError` for anything else.
    """
    return content.decode(json.detect_encoding(content))

"""Files that appear whole or not at all, and paths that stay inside their folder."""

import contextlib
import errno
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError, ResourceError, shown
from lightprobe.core.reading import LARGEST_TEXT, check_file


@contextlib.contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn operating-system write failures (disk full, read-only, no permission) into a `ResourceError`."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise ResourceError(f"The disk is full: could not write {path}; free some space and run again.") from error
        raise ResourceError(f"Could not write {path}: {error.strerror or error}.") from error


@contextlib.contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary sibling of `path` to write to; rename it into place on success, delete it on failure.

    The temporary keeps the suffix, because image and mesh writers choose their format by it.
    """
    path = Path(path)
    with disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=".partial-", suffix=path.suffix)
        os.close(handle)
    temporary = Path(name)
    try:
        with disk_errors(path):
            yield temporary
            with open(temporary, "rb") as written:
                os.fsync(written.fileno())
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path`; on success rename it into place, replacing an old one, else delete it."""
    path = Path(path)
    with disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=path.parent, prefix=".partial-"))
    try:
        with disk_errors(path):
            yield temporary
            os.chmod(temporary, 0o755)
            if path.exists():
                shutil.rmtree(path)
            os.replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Write `data` to `path` atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_json(path: Path, value: Any) -> None:
    """Write `value` as indented JSON atomically; NaN and infinity are refused, as JSON has no word for them."""
    write_bytes(path, (json.dumps(value, indent=2, allow_nan=False) + "\n").encode())


def read_json(path: Path) -> Any:
    """Return the value of a JSON file; raise `InputError` naming the file and line when it is missing or malformed."""
    check_file(path, LARGEST_TEXT)
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist.") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read as text: {error}.") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path} is not valid JSON (line {error.lineno}: {error.msg}).") from error
    except RecursionError as error:
        raise InputError(f"{path} cannot be read as JSON: it is nested too deeply.") from error
    except ValueError as error:  # Python reads integers up to a length only
        raise InputError(f"{path} cannot be read as JSON: it holds a number of too many digits.") from error


def inside(root: Path, relative: str, *, source: Path) -> Path:
    """Return `root/relative`, refusing a path that leaves `root` (absolute, `..`, or through a link).

    Refused as well: what cannot be a file's name, such as one with a zero byte, too long, or a link to itself.
    `source` is the file that named the path and appears in the error.
    """
    root = Path(root).resolve()
    candidate = resolved(root / relative)
    if candidate is None:
        raise InputError(
            f"{source} names '{shown(relative)}', which is no file name or lies where nothing may be read; correct it."
        )
    if not candidate.is_relative_to(root):
        raise InputError(
            f"{source} names '{shown(relative)}', which lies outside {root}; use paths inside the scene folder."
        )
    return candidate


def resolved(path: Path) -> Path | None:
    """Return `path` absolute and without links, or None where the system takes it for no name of a file."""
    try:
        whole = path.resolve()
        whole.is_file()
    except (OSError, ValueError, RuntimeError):  # too long or forbidden; a zero byte or half a character; a link loop
        return None
    return whole


def checksum(path: Path) -> str:
    """Return the hexadecimal BLAKE2b-128 checksum of a file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()

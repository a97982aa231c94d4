"""Files that appear whole or not at all, and paths that stay inside their folder."""

import contextlib
import errno
import hashlib
import json
import os
import shlex
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from lightprobe.core.errors import ConfigError, InputError, LockedError, ResourceError, shown
from lightprobe.core.partial import partial_file, partial_folder
from lightprobe.core.reading import LARGEST_TEXT, check_file, decode_text

_LONGEST_NAME = 255  # bytes of a file's name, on all systems in use


@contextlib.contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn operating-system write failures (disk full, read-only, no permission) into a `ResourceError`."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise ResourceError(f"The disk is full: could not write {path}; free some space.") from error
        raise ResourceError(f"Could not write {path}: {error.strerror or error}.") from error


def _umask() -> int:
    """Return which permissions the user takes from new files; asking for it sets it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


_UMASK = _umask()  # asked once, before there are threads whose files it could hit


@contextlib.contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary sibling of `path` to write to; rename it into place on success, delete it on failure.

    The temporary keeps the suffix, because image and mesh writers choose their format by it.
    """
    path = Path(path)
    with disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial_file(path.parent, path.suffix) as temporary:
            yield temporary
            with open(temporary, "rb") as written:
                os.fsync(written.fileno())
            os.chmod(temporary, 0o666 & ~_UMASK)
            os.replace(temporary, path)


@contextlib.contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder; on success it takes the place of `path`, else it is deleted."""
    path = Path(path)
    with disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial_folder(path.parent) as temporary:
            yield temporary
            os.chmod(temporary, 0o777 & ~_UMASK)
            if path.exists():
                shutil.rmtree(path)
            os.replace(temporary, path)


@contextlib.contextmanager
def filled_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder in `path`, whose contents move up into `path` on success or are deleted.

    What a killed process leaves is a hidden folder that the next call clears away. What `path` already holds
    stays.
    """
    path = Path(path)
    there = path.exists()
    try:
        with disk_errors(path):
            path.mkdir(parents=True, exist_ok=True)
            with partial_folder(path) as temporary:
                yield temporary
                for entry in sorted(temporary.iterdir()):
                    os.replace(entry, path / entry.name)
    except BaseException:
        if not there:
            with contextlib.suppress(OSError):  # not empty: somebody else's file has come
                path.rmdir()
        raise


@contextlib.contextmanager
def locked_file(path: Path, busy: str) -> Iterator[None]:
    """Hold the file at `path` locked, made when there is none; raise `LockedError` if another does.

    The lock dies with its process.
    """
    lock = FileLock(path, timeout=0, mode=0o644)
    with disk_errors(path):
        try:
            lock.acquire()
        except Timeout as error:
            raise LockedError(busy) from error
    try:
        yield
    finally:
        lock.release()


def write_bytes(path: Path, data: bytes) -> None:
    """Write `data` to `path` atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_json(path: Path, value: Any) -> None:
    """Write `value` as indented JSON atomically; NaN and infinity are refused, as JSON has no word for them."""
    write_bytes(path, (json.dumps(value, indent=2, allow_nan=False) + "\n").encode())


def append_text(path: Path, text: str) -> None:
    """Append `text` to a file, made when there is none; never through a link, which could lead anywhere."""
    handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
    with open(handle, "a", encoding="utf-8", errors="backslashreplace") as file:
        file.write(text)


def read_json(path: Path) -> Any:
    """Return the value of a JSON file; raise `InputError` naming file and line where it is damaged."""
    check_file(path, LARGEST_TEXT)
    try:
        return json.loads(decode_text(Path(path).read_bytes()))
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


def remove(*paths: Path) -> None:
    """Delete files, links and whole folders, where they exist."""
    for path in paths:
        with disk_errors(path):
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)


def holds_files(folder: Path) -> bool:
    """Return whether a folder is there and holds anything but hidden files."""
    return folder.is_dir() and any(not path.name.startswith(".") for path in folder.iterdir())


def refuse_replacing(written: Iterable[Path | None], read: Iterable[Path | None]) -> None:
    """Raise `ConfigError` where a file to be written is one that is read or is written twice."""
    sources = {path.resolve() for path in read if path is not None}
    taken: set[Path] = set()
    for path in written:
        if path is None:
            continue
        place = path.resolve()
        if place in sources:
            raise ConfigError(
                f"{path} would be replaced, and is one of the files that are read; name another."
            )
        if place in taken:
            raise ConfigError(f"Two of the files would be {path}; give them different names.")
        taken.add(place)


def shell_word(value: object) -> str:
    """Return a value as one word of a shell, for commands that are printed to be copied."""
    return shlex.quote(str(value))


def inside(root: Path, relative: str, *, source: Path, follow_links: bool = False) -> Path:
    """Return `root/relative`, refusing a path that leaves `root` (absolute, `..`, or through a link).

    With `follow_links`, links that lie in `root` may lead elsewhere, as their owner has put them there. Refused as
    well: what cannot be a file's name, such as one with a zero byte, too long, or a link to itself. `source` is
    the file that named the path and appears in the error.
    """
    root = Path(root).resolve()
    candidate = resolved(root / relative)
    if follow_links and candidate is not None:
        place = Path(os.path.normpath(root / relative))
        candidate = place if place.is_relative_to(root) and resolved(place) is not None else candidate
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
    except (OSError, ValueError, RuntimeError):  # too long, forbidden, a zero byte, a loop of links
        return None
    return whole


def named_file(folder: Path, name: str, suffix: str = "") -> Path:
    """Return `folder`/`name``suffix`, refusing a `name` that is not the plain name of one file.

    Every name that comes out of a file, such as a photo's in scene.json, becomes a path here and nowhere
    else.
    """
    if not is_file_name(name) or not is_file_name(f"{name}{suffix}"):
        raise InputError(f"{name[:200]!a} cannot name a file in {folder}: it must be a plain name, no path.")
    return Path(folder) / f"{name}{suffix}"


def is_file_name(name: str) -> bool:
    """Return whether `name` is the plain name of a file: no path, and nothing that a path cannot hold."""
    try:
        encoded = os.fsencode(name)
    except UnicodeEncodeError:
        return False
    return (
        b"\0" not in encoded
        and len(encoded) <= _LONGEST_NAME
        and name not in ("", ".", "..")
        and Path(name).name == name
    )


def checksum(path: Path) -> str:
    """Return the hexadecimal BLAKE2b-128 checksum of a file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()

"""Files that come in over HTTP: written as they arrive, up to a limit; their names are only shown, never
used.
"""

from collections.abc import Mapping
from pathlib import Path
from urllib.parse import unquote

from starlette.requests import Request

from lightprobe.core.errors import InputError, shown
from lightprobe.core.files import disk_errors
from lightprobe.imaging import IMAGE_SUFFIXES
from lightprobe.service.errors import TooLargeError

_SHOWN_NAME = 80  # characters


def shown_name(quoted: str) -> str:
    """Return a file's name out of a header as it may be shown: no folders, nothing unprintable, not long."""
    name = unquote(quoted).replace("\\", "/").rpartition("/")[2]
    return shown(name)[:_SHOWN_NAME] or "this file"


def photo_suffix(name: str) -> str:
    """Return the suffix that a photo of a stranger's name is kept with: its own if photos have it, else .png.

    What it is its content tells; some decoders of camera raw look at the suffix, too.
    """
    suffix = Path(name).suffix.lower()
    return suffix if suffix in IMAGE_SUFFIXES else ".png"


async def stream_to(request: Request, path: Path, limit: int, name: str) -> None:
    """Write a request's body to a new file; raise `TooLargeError` before more than `limit` bytes are written."""
    check_length(request, limit, name)
    written = 0
    with disk_errors(path), open(path, "xb") as file:
        async for chunk in request.stream():
            written += len(chunk)
            if written > limit:
                raise TooLargeError.of(name, limit)
            file.write(chunk)
    if written == 0:
        raise InputError(f"{name} is empty; choose another file.")


def check_length(request: Request, limit: int, name: str) -> None:
    """Raise `TooLargeError` where a request announces a body of more than `limit` bytes."""
    length = request.headers.get("content-length", "")
    if length.isdigit() and (len(length) > len(str(limit)) or int(length) > limit):
        raise TooLargeError.of(name, limit)


def renamed(sentence: str, names: Mapping[Path, str]) -> str:
    """Return a sentence in which files are called as the person knows them, longest paths first."""
    for path in sorted(names, key=lambda one: -len(str(one))):
        sentence = sentence.replace(str(path), names[path])
    for path, name in names.items():
        sentence = sentence.replace(path.name, name)
    return sentence

"""Files that come in over HTTP: kept up to a limit under names of our own; the names they come with are only
shown.
"""

import contextlib
import secrets
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData
from starlette.exceptions import HTTPException
from starlette.requests import Request

from lightprobe.core.errors import ConfigError, InputError, ResourceError, shown
from lightprobe.core.files import disk_errors
from lightprobe.imaging import IMAGE_SUFFIXES
from lightprobe.web.asgi import announced_length
from lightprobe.web.errors import MIB, RefusedError, too_large

_SHOWN_NAME = 80  # characters
_FIELDS = 64  # of a form
_REPEATED = ","  # between the values of a field that comes more than once


@dataclass(frozen=True)
class Part:
    """A file that came in with a form."""

    path: Path
    name: str  # as the client calls it, for messages only


@dataclass(frozen=True)
class Form:
    """A form: its files, and its other fields as text."""

    parts: dict[str, Part] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)


def shown_name(given: str) -> str:
    """Return a file's name as it may be shown: no folders, nothing unprintable, not long."""
    return shown(given.replace("\\", "/").rpartition("/")[2])[:_SHOWN_NAME] or "this file"


def photo_suffix(name: str) -> str:
    """Return the suffix that a photo of a stranger's name is kept with: its own if photos have it, else .png.

    A photo's format is told by its content; some decoders of camera raw look at the suffix, too.
    """
    suffix = Path(name).suffix.lower()
    return suffix if suffix in IMAGE_SUFFIXES else ".png"


def renamed(sentence: str, names: Mapping[Path, str]) -> str:
    """Return a sentence in which files are called as the person knows them, longest paths first."""
    for path in sorted(names, key=lambda one: -len(str(one))):
        sentence = sentence.replace(str(path), names[path])
    for path, name in names.items():
        sentence = sentence.replace(path.name, name)
    return sentence


@contextlib.contextmanager
def renaming(names: Mapping[Path, str]) -> Iterator[None]:
    """Let errors about files inside call them as the person knows them."""
    try:
        yield
    except (InputError, ConfigError, ResourceError) as error:
        raise type(error)(renamed(str(error), names)) from error


async def receive_file(request: Request, path: Path, limit: int, name: str) -> None:
    """Write a request's body to a new file; raise `RefusedError` (413) before more than `limit` bytes are written."""
    if announced_length(request.headers) > limit:
        raise too_large(name, limit)
    written = 0
    with disk_errors(path), open(path, "xb") as file:
        async for chunk in request.stream():
            written += len(chunk)
            if written > limit:
                raise too_large(name, limit)
            file.write(chunk)
    if written == 0:
        raise InputError(f"{name} is empty; choose another file.")


def quoted_name(request: Request) -> str:
    """Return the name of the file in a request's body, which its header X-File-Name has percent-encoded."""
    return shown_name(unquote(request.headers.get("x-file-name", "")))


async def receive_form(request: Request, folder: Path, limits: Mapping[str, int]) -> Form:
    """Return the form that a request's body holds, its files written into `folder`.

    limits: the most bytes of each field; others are refused. A field with a file name is a file.
    Raises `RefusedError` for another kind of body (415) and a field that is too large (413), `InputError`
    for a body that is damaged. How large a body may be is limited by the gate.
    """
    if not request.headers.get("content-type", "").lower().startswith("multipart/form-data"):
        raise RefusedError(415, "The body must be a form with files: multipart/form-data with a boundary.")
    try:
        with disk_errors(folder):
            async with request.form(max_files=len(limits), max_fields=_FIELDS, max_part_size=MIB) as given:
                return await run_in_threadpool(_stored, given, folder, limits)
    except HTTPException as error:  # Starlette's for a body that its parser refuses
        raise InputError(
            f"The body is no form that can be read ({shown(error.detail).rstrip('.')})."
        ) from error


def _stored(given: FormData, folder: Path, limits: Mapping[str, int]) -> Form:
    form = Form()
    for field_name, value in given.multi_items():
        if field_name not in limits:
            raise InputError(f"There is no field '{shown(field_name)}'; there are {', '.join(limits)}.")
        size = len(value.encode()) if isinstance(value, str) else value.size or 0
        if size > limits[field_name]:
            raise too_large(f"The field '{field_name}'", limits[field_name])
        if isinstance(value, str):
            before = form.texts.get(field_name)
            form.texts[field_name] = value if before is None else before + _REPEATED + value
            continue
        if field_name in form.parts:
            raise InputError(f"The form has two files '{field_name}'; send one.")
        if size == 0:
            raise InputError(f"The file '{field_name}' is empty; choose another file.")
        name = shown_name(value.filename or "")
        path = folder / f"{field_name}-{secrets.token_hex(8)}{photo_suffix(name)}"
        with open(path, "xb") as file:
            shutil.copyfileobj(value.file, file)
        form.parts[field_name] = Part(path, name)
    return form

"""Forms with files (multipart/form-data, RFC 7578), taken apart as they arrive, each field up to a limit of
its own.
"""

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import Request

from lightprobe.core.errors import InputError, shown
from lightprobe.core.files import disk_errors
from lightprobe.service.errors import MediaTypeError, TooLargeError
from lightprobe.service.incoming import check_length, photo_suffix, shown_name

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

_HEAD = 8192  # bytes of a part's headers
_PARTS = 64  # fields of a form
_TEXT_REPEATED = ","  # between the values of a field that comes more than once


@dataclass(frozen=True)
class Part:
    """A file that came in."""

    path: Path
    name: str  # as the client calls it, for messages only


@dataclass(frozen=True)
class Form:
    """A form: its files, and its other fields as text."""

    parts: dict[str, Part] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)


async def receive_form(request: Request, folder: Path, limits: Mapping[str, int]) -> Form:
    """Return the form that a request's body holds, its files written into `folder`.

    limits: the most bytes of each field; others are refused. A field with a file name is a file.
    Raises `MediaTypeError` for another kind of body, `TooLargeError` as soon as a field is too large,
    `InputError` for a body that is damaged.
    """
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    boundary = options.get(b"boundary", b"")
    if (
        kind != b"multipart/form-data" or not 0 < len(boundary) <= 70
    ):  # the longest of RFC 2046, section 5.1.1
        raise MediaTypeError("The body must be a form with files: multipart/form-data with a boundary.")
    whole = sum(limits.values()) + _PARTS * _HEAD
    check_length(request, whole, "The request")
    receiver, written = _Receiver(folder, limits), 0
    parser = MultipartParser(boundary, receiver.callbacks())
    try:
        with disk_errors(folder):
            async for chunk in request.stream():
                written += len(chunk)
                if written > whole:
                    raise TooLargeError.of("The request", whole)
                parser.write(chunk)
    except FormParserError as error:
        raise InputError(f"The body is no multipart/form-data ({shown(str(error))}).") from error
    finally:
        receiver.close()
    if not receiver.ended:
        raise InputError("The body ends in the middle of a field; send it again.")
    return receiver.form


class _Receiver:
    """What the parser tells of, part by part."""

    def __init__(self, folder: Path, limits: Mapping[str, int]):
        self.form, self.ended = Form(), False
        self._folder, self._limits = folder, limits
        self._count = 0
        self._file: BinaryIO | None = None
        self._begin()

    def callbacks(self) -> "MultipartCallbacks":
        """Return the functions that the parser calls."""
        return {
            "on_part_begin": self._begin,
            "on_part_data": self._data,
            "on_part_end": self._end,
            "on_header_field": self._header_name,
            "on_header_value": self._header_value,
            "on_header_end": self._header_end,
            "on_headers_finished": self._headers_finished,
            "on_end": self._finish,
        }

    def close(self) -> None:
        """Close the file at hand."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _begin(self) -> None:
        self._count += 1
        if self._count > _PARTS + 1:  # it is called once before the first
            raise InputError(f"The form has more than {_PARTS} fields.")
        self._headers: dict[bytes, bytes] = {}
        self._key, self._value = bytearray(), bytearray()
        self._head = self._size = 0
        self._text = bytearray()

    def _header_name(self, data: bytes, start: int, end: int) -> None:
        self._head_bytes(end - start)
        self._key += data[start:end]

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._head_bytes(end - start)
        self._value += data[start:end]

    def _head_bytes(self, count: int) -> None:
        self._head += count
        if self._head > _HEAD:
            raise InputError("A field of the form has headers of more than 8 kB.")

    def _header_end(self) -> None:
        self._headers[bytes(self._key).lower()] = bytes(self._value)
        self._key, self._value = bytearray(), bytearray()

    def _headers_finished(self) -> None:
        _, options = parse_options_header(self._headers.get(b"content-disposition", b""))
        self._name = options.get(b"name", b"").decode("utf-8", "replace")
        if self._name not in self._limits:
            raise InputError(f"There is no field '{shown(self._name)}'; there are {', '.join(self._limits)}.")
        if b"filename" not in options:
            return
        if self._name in self.form.parts:
            raise InputError(f"The form has two files '{self._name}'; send one.")
        name = shown_name(options[b"filename"].decode("utf-8", "replace").replace("%", "%25"))
        path = self._folder / f"{self._name}-{secrets.token_hex(8)}{photo_suffix(name)}"
        self.form.parts[self._name] = Part(path, name)
        self._file = open(path, "xb")  # noqa: SIM115  closed with the part, or by `close`

    def _data(self, data: bytes, start: int, end: int) -> None:
        self._size += end - start
        if self._size > self._limits[self._name]:
            raise TooLargeError.of(f"The field '{self._name}'", self._limits[self._name])
        if self._file is not None:
            self._file.write(data[start:end])
        else:
            self._text += data[start:end]

    def _end(self) -> None:
        if self._file is not None:
            self.close()
            if self._size == 0:
                raise InputError(f"The file '{self._name}' is empty; choose another file.")
            return
        before = self.form.texts.get(self._name)
        text = self._text.decode("utf-8", "replace")
        self.form.texts[self._name] = text if before is None else before + _TEXT_REPEATED + text

    def _finish(self) -> None:
        self.ended = True

"""Answers to a prediction: one JSON object with the files inside, a ZIP archive, or the map alone, as Accept
says.
"""

import base64
import json
import re
import zipfile
from enum import StrEnum
from http import HTTPStatus
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from starlette.background import BackgroundTask
from starlette.responses import FileResponse, Response

from lightprobe.jobs import AnswerFiles, Output
from lightprobe.web.errors import RefusedError

_WEIGHT = re.compile(r"[01](\.\d{0,3})?")
ANSWER, LIGHT, ARCHIVE = "answer.json", "light.light.json", "light.zip"
_MEDIA_TYPES = {
    ".exr": "image/x-exr",
    ".hdr": "image/vnd.radiance",
    ".png": "image/png",
    ".json": "application/json",
}


class AnswerKind(StrEnum):
    """What an answer is, by its media type."""

    JSON = "application/json"
    """Everything in one object, files as base64."""
    ZIP = "application/zip"
    """The files beside light.light.json and answer.json."""
    EXR = "image/x-exr"
    """Only the map."""
    HDR = "image/vnd.radiance"
    """Only the map."""

    @property
    def output(self) -> Output | None:
        """The file that alone is the answer, None where there are more."""
        return {AnswerKind.EXR: Output.EXR, AnswerKind.HDR: Output.HDR}.get(self)


def accepted_kind(header: str) -> AnswerKind:
    """Return the kind of answer that an Accept header prefers (RFC 9110, section 12.5.1).

    Without a header, and where several are as welcome, JSON comes first. Raises `RefusedError` (406) where none
    is welcome.
    """
    ranges = {}
    for entry in (header.strip() or "*/*").lower().split(","):
        name, *parameters = (part.strip() for part in entry.split(";"))
        weight = next((part[2:] for part in parameters if part.startswith("q=")), "1")
        ranges[name] = float(weight) if _WEIGHT.fullmatch(weight) else 0.0

    def weight_of(kind: AnswerKind) -> float:
        """Return the weight of the most specific range that has the kind."""
        main = kind.partition("/")[0]
        return next((ranges[name] for name in (kind.value, f"{main}/*", "*/*") if name in ranges), 0.0)

    best = max(AnswerKind, key=weight_of)
    if weight_of(best) == 0:
        raise RefusedError(
            406, f"The answer can be {', '.join(AnswerKind)}; ask for one of these with Accept."
        )
    return best


def answer(kind: AnswerKind, told: dict[str, Any], folder: Path, done: BackgroundTask) -> Response:
    """Return the answer out of what a worker has told and the files that it wrote; `done` follows when it is
    sent.

    told: with the light file as "light" and the names of the files as "files".
    """
    if kind.output is not None:
        path = AnswerFiles.within(folder, (kind.output,)).light
        headers = {"x-lightprobe-verdict": told["verdict"]["status"], "x-lightprobe-method": told["method"]}
        return FileResponse(path, media_type=kind.value, filename=path.name, headers=headers, background=done)
    if kind is AnswerKind.ZIP:
        _write_archive(told, folder)
        return FileResponse(folder / ARCHIVE, media_type=kind.value, filename=ARCHIVE, background=done)
    files = [{**_described(folder / name), "base64": _encoded(folder / name)} for name in told["files"]]
    return Response(_json({**told, "files": files}), media_type=kind.value, background=done)


def _described(path: Path) -> dict[str, Any]:
    return {"name": path.name, "media_type": _MEDIA_TYPES[path.suffix], "bytes": path.stat().st_size}


def _encoded(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode()


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False).encode()


def _write_archive(told: dict[str, Any], folder: Path) -> None:
    """Write all files of an answer as one archive; maps hardly get smaller, so that nothing is compressed."""
    rest = {key: value for key, value in told.items() if key != "light"}
    about = {**rest, "files": [_described(folder / name) for name in told["files"]]}
    with zipfile.ZipFile(folder / ARCHIVE, "w") as archive:
        archive.writestr(ANSWER, _json(about))
        archive.writestr(LIGHT, _json(told["light"]))
        for name in told["files"]:
            archive.write(folder / name, name)


class Refusal(BaseModel):
    """Why a request was refused or failed."""

    sentence: str
    request: str = ""
    """Its id, as in the log."""


class AnswerFile(BaseModel):
    """A file of an answer."""

    name: str
    media_type: str
    bytes: int
    base64: str


class Answer(BaseModel):
    """A prediction."""

    object: str
    request: str
    method: str
    verdict: dict[str, Any]
    """Whether the photo can be what it is taken for, see docs/photos.md."""
    pose: dict[str, Any] | None
    """The same of the camera that was found; null: it was given."""
    background: str
    """What became of what the photo shows around the object."""
    warnings: list[str]
    seconds: dict[str, float]
    """waiting, load, locate, the parts of the prediction and all."""
    light: dict[str, Any]
    """The light in numbers: docs/light-files.md."""
    files: list[AnswerFile]


_BINARY = {"schema": {"type": "string", "format": "binary"}}
_REFUSALS = (404, 406, 408, 413, 415, 422, 429, 500, 503, 504)
RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "model": Answer,
        "description": "The prediction.",
        "content": {kind.value: _BINARY for kind in AnswerKind if kind is not AnswerKind.JSON},
    },
    **{status: {"model": Refusal, "description": HTTPStatus(status).phrase} for status in _REFUSALS},
}
"""The answers to it."""

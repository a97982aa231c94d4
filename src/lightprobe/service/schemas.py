"""The interface in words for /openapi.json: bodies and answers that FastAPI cannot read off the functions."""

from typing import Any

from pydantic import BaseModel

from lightprobe.service.answers import AnswerKind
from lightprobe.service.fields import FIELDS
from lightprobe.web.errors import STATUS


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


BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["photo"],
                    "properties": {
                        name: {**schema, "description": f"{words} At most {limit} bytes."}
                        for name, (limit, words, schema) in FIELDS.items()
                    },
                }
            }
        },
    }
}
"""The body of a prediction."""

_BINARY = {"schema": {"type": "string", "format": "binary"}}
RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "model": Answer,
        "description": "The prediction.",
        "content": {kind.value: _BINARY for kind in AnswerKind if kind is not AnswerKind.JSON},
    },
    **{
        status: {
            "model": Refusal,
            "description": " ".join(kind.__doc__ or "" for kind in STATUS if STATUS[kind] == status),
        }
        for status in sorted(set(STATUS.values()))
    },
}
"""The answers to it."""

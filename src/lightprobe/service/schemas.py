"""The interface in words for /openapi.json: bodies and answers that FastAPI cannot read off the functions."""

from typing import Any

from pydantic import BaseModel

from lightprobe.service.answers import AnswerKind
from lightprobe.service.fields import FIELDS


class ObjectEntry(BaseModel):
    """An object that light can be predicted with."""

    name: str
    trained: bool
    """Whether it has a model; without one the light is only solved for."""
    locatable: bool
    """Whether photos without a camera can be taken at once."""
    calibrated: bool
    """Whether the brightness of its maps is the true one."""


class ObjectList(BaseModel):
    """Objects in the order of their names."""

    objects: list[ObjectEntry]
    next: str | None
    """What to give as `after` for those that follow; null: these are all."""


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
_REASONS = {
    404: "There is no such object.",
    406: "None of the kinds of answer is accepted.",
    408: "The body did not arrive in time.",
    413: "A field is too large.",
    415: "The body is no form.",
    422: "A field cannot be used, or the photo does not show the object.",
    429: "Too much waits; see Retry-After.",
    500: "The worker ended twice on this request, or something unexpected.",
    503: "Not now; see Retry-After.",
    504: "The deadline is over.",
}
RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "model": Answer,
        "description": "The prediction.",
        "content": {kind.value: _BINARY for kind in AnswerKind if kind is not AnswerKind.JSON},
    },
    **{status: {"model": Refusal, "description": words} for status, words in _REASONS.items()},
}
"""The answers to it."""

"""The fields of a request's form: the request for a prediction and a deadline, their limits and their meaning."""

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

from lightprobe.core.errors import ConfigError, InputError, shown
from lightprobe.imaging.opening import file_kind
from lightprobe.jobs.request import LightOptions, Output, PredictRequest, field_help, json_schema, parsed
from lightprobe.scene.camera import Camera
from lightprobe.web.errors import MIB
from lightprobe.web.uploads import Form

_TYPES, _HELP = get_type_hints(PredictRequest), field_help(PredictRequest)
_FILE, _TEXT = {"type": "string", "format": "binary"}, 64  # bytes of an option
_OPTIONS = {field.name: json_schema(_TYPES[field.name], field.default) for field in fields(LightOptions)}
_OUTPUTS = json_schema(_TYPES["outputs"], PredictRequest.outputs)

FIELDS: Mapping[str, tuple[int, str, dict[str, Any]]] = {
    "photo": (64 * MIB, _HELP["photo"], _FILE),
    "camera": (
        MIB,
        "Its camera as JSON, text or file; by default the object is looked for.",
        json_schema(str),
    ),
    "mask": (32 * MIB, "White object on black, PNG; by default the photo's alpha, or found.", _FILE),
    **{name: (_TEXT, _HELP[name], schema) for name, schema in _OPTIONS.items()},
    "formats": (256, "The wanted files; repeated or separated by commas.", _OUTPUTS),
    "deadline": (
        32,
        "Seconds after which the answer is worth nothing to you; at most the server's own.",
        {"type": "number", "exclusiveMinimum": 0},
    ),
}
"""Fields of a request: the most bytes, what they are for, and their JSON schema."""

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


def predict_request(form: Form, folder: Path) -> tuple[PredictRequest, float | None]:
    """Return the request that a form makes and its deadline in seconds; nothing of the photo is decoded yet.

    A camera is written into `folder` once it is known to be one. Raises `InputError` for fields that are
    missing or cannot be read, `ConfigError` for values that are none.
    """
    photo, mask = form.parts.get("photo"), form.parts.get("mask")
    if photo is None:
        raise InputError("There is no photo: send one as the field 'photo' of a multipart/form-data body.")
    for part in (photo, mask):
        if part is not None:
            file_kind(part.path)
    outputs: tuple[Output, ...] = parsed(_TYPES["outputs"], form.texts.get("formats", ""), "formats")
    request = PredictRequest(
        photo=photo.path,
        camera=_camera(form, folder),
        mask=None if mask is None else mask.path,
        name=photo.name,
        outputs=outputs or PredictRequest.outputs,
        **vars(LightOptions().updated(form.texts)),
    )
    return request, _deadline(form.texts.get("deadline", ""))


def _camera(form: Form, folder: Path) -> Path | None:
    """Return a file with the camera of a form, or None; raise `InputError` unless it is one."""
    part, text = form.parts.get("camera"), form.texts.get("camera", "")
    data = part.path.read_bytes() if part is not None else text.encode()
    if not data.strip():
        return None
    try:
        camera = Camera.from_json(json.loads(data), source="the camera")
    except RecursionError as error:
        raise InputError("The camera cannot be read as JSON: it is nested too deeply.") from error
    except ValueError as error:  # no JSON, no text, or a number of too many digits
        raise InputError(f"The camera is not valid JSON ({shown(str(error))}).") from error
    path = folder / "given-camera.json"
    path.write_text(json.dumps(camera.to_json()), encoding="utf-8")
    return path


def _deadline(text: str) -> float | None:
    seconds: float | None = parsed(float, text, "deadline") if text else None
    if seconds is not None and not 0 < seconds < float("inf"):
        raise ConfigError(f"'deadline' must be a number of seconds above 0, not '{shown(text)}'.")
    return seconds

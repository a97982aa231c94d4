"""What a request for a prediction asks for: its fields as they come, their limits, and what they mean."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar

from lightprobe.core.config.prediction import Method, Sun
from lightprobe.core.errors import ConfigError, InputError, shown
from lightprobe.imaging.opening import file_kind
from lightprobe.light.upsampling import map_height
from lightprobe.scene.camera import Camera
from lightprobe.web.errors import MIB
from lightprobe.web.uploads import Form, Part


class Output(StrEnum):
    """A file that an answer may have."""

    EXR = "exr"
    """The environment map, OpenEXR."""
    HDR = "hdr"
    """The environment map, Radiance HDR."""
    PNG = "png"
    """A picture of the map."""
    CONFIDENCE = "confidence"
    """How far each direction can be trusted, a one-channel OpenEXR."""
    MASK = "mask"
    """Where the object was taken to be, PNG."""
    OVERLAY = "overlay"
    """The photo with the object's outline, PNG; only where the object was looked for."""


FILES: Mapping[Output, str] = {
    Output.EXR: "light.exr",
    Output.HDR: "light.hdr",
    Output.PNG: "light.png",
    Output.CONFIDENCE: "confidence.exr",
    Output.MASK: "mask.png",
    Output.OVERLAY: "overlay.png",
}
"""The names of these files."""

MEDIA_TYPES: Mapping[str, str] = {
    ".exr": "image/x-exr",
    ".hdr": "image/vnd.radiance",
    ".png": "image/png",
    ".json": "application/json",
}
"""Kinds of files by their suffixes."""

FIELDS: Mapping[str, tuple[int, str]] = {
    "photo": (64 * MIB, "The photo, any format that `lightprobe predict` reads."),
    "camera": (MIB, "Its camera as JSON, text or file; by default the object is looked for."),
    "mask": (32 * MIB, "White object on black, PNG; by default the photo's alpha, or found with the camera."),
    "method": (64, "How the light is found; by default the run's own, or the best it has a model for."),
    "size": (
        32,
        "Size of the maps, 128x64 to 4096x2048 by powers of two; by default that of the prediction.",
    ),
    "sun": (32, "inside: the map has its suns and lamps; separate: they stand in the light file alone."),
    "sources": (8, "false: suns and lamps are not looked for, which saves much of a single step's time."),
    "background": (8, "false: what an opaque photo shows around the object is not used."),
    "formats": (256, f"The wanted files, any of {', '.join(Output)}; repeated or separated by commas."),
    "deadline": (32, "Seconds after which the answer is worth nothing to you; at most the server's own."),
}
"""Fields of a request: the most bytes, and what they are for."""

_DEFAULT_OUTPUTS = (Output.EXR, Output.CONFIDENCE)
_YES = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


@dataclass(frozen=True)
class Asked:
    """A request for a prediction, its fields checked; nothing of the photo is decoded yet."""

    photo: Part
    camera: Path | None
    mask: Part | None
    method: Method | None
    height: int | None  # rows of the maps
    sun: Sun
    sources: bool
    background: bool
    outputs: tuple[Output, ...]
    deadline: float | None  # seconds

    @staticmethod
    def of(form: Form, folder: Path) -> "Asked":
        """Return what a form asks for; a camera is written into `folder` once it is known to be one.

        Raises `InputError` for fields that are missing or cannot be read, `ConfigError` for values that are
        none.
        """
        photo, mask, text = form.parts.get("photo"), form.parts.get("mask"), form.texts
        if photo is None:
            raise InputError(
                "There is no photo: send one as the field 'photo' of a multipart/form-data body."
            )
        file_kind(photo.path)
        if mask is not None:
            file_kind(mask.path)
        size, sources = text.get("size"), _flag(text, "sources", True)
        sun = _choice(Sun, text.get("sun", Sun.INSIDE), "sun")
        sun.check(sources)
        method = text.get("method")
        return Asked(
            photo,
            _camera(form, folder),
            mask,
            None if not method else _choice(Method, method, "method"),
            None if not size else map_height(size),
            sun,
            sources,
            _flag(text, "background", True),
            _outputs(text.get("formats", "")),
            _deadline(text.get("deadline")),
        )

    def to_json(self) -> dict[str, Any]:
        """Return what the worker is told."""
        return {
            "photo": str(self.photo.path),
            "name": self.photo.name,
            "camera": None if self.camera is None else str(self.camera),
            "mask": None if self.mask is None else str(self.mask.path),
            "method": self.method,
            "height": self.height,
            "sun": self.sun,
            "sources": self.sources,
            "background": self.background,
            "outputs": list(self.outputs),
        }


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


def _flag(text: Mapping[str, str], name: str, otherwise: bool) -> bool:
    value = text.get(name, "").strip().lower()
    if value and value not in _YES:
        raise ConfigError(f"'{name}' must be true or false, not '{shown(value)}'.")
    return _YES.get(value, otherwise)


_Choice = TypeVar("_Choice", bound=StrEnum)


def _choice(kind: type[_Choice], value: str, name: str) -> _Choice:
    try:
        return kind(value.strip().lower())
    except ValueError as error:
        raise ConfigError(f"'{name}' must be one of {', '.join(kind)}, not '{shown(value)}'.") from error


def _outputs(text: str) -> tuple[Output, ...]:
    names = [word for word in text.replace(",", " ").split() if word]
    return tuple(dict.fromkeys(_choice(Output, name, "formats") for name in names)) or _DEFAULT_OUTPUTS


def _deadline(text: str | None) -> float | None:
    if not text:
        return None
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not 0 < seconds < float("inf"):
        raise ConfigError(f"'deadline' must be a number of seconds above 0, not '{shown(text)}'.")
    return seconds

"""What a prediction is asked for: the fields that every door offers, and how they come as text and as JSON.

Command line, service, page and fleet derive their options, form fields and columns from `LightOptions`.
"""

import ast
import functools
import inspect
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from types import UnionType
from typing import Any, Self, get_args, get_origin, get_type_hints

from lightprobe.core.config.prediction import Method, Sun
from lightprobe.core.errors import ConfigError, shown
from lightprobe.light.upsampling import map_height

_WORDS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


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
    CAMERA = "camera"
    """The photo's camera, JSON."""
    MASK = "mask"
    """Where the object was taken to be, PNG."""
    OVERLAY = "overlay"
    """The photo with the object's outline, PNG."""


@dataclass(frozen=True)
class LightOptions:
    """How the light in a photo is predicted and its map is written.

    Each field is an option of the command line, a form field of the service, and an option and a column of a
    fleet. The docstring of the field is its help everywhere.
    """

    method: Method | None = None
    """How the light is found; by default the run's own, or the best it has a model for."""
    size: str | None = None
    """Size of the maps, 128x64 to 4096x2048 by powers of two; by default that of the prediction."""
    sun: Sun = Sun.INSIDE
    """inside: the map has its suns and lamps; separate: they stand in the light file alone."""
    sources: bool = True
    """Look for suns and lamps, some .3 s a photo: most of what a method of a single step costs."""
    background: bool = True
    """Use what the photo shows around the object; not for photos close to a wall or a table."""

    def __post_init__(self) -> None:
        """Raise `ConfigError` for values that no prediction could use."""
        if self.size is not None:
            map_height(self.size)
        self.sun.check(self.sources)

    @property
    def height(self) -> int | None:
        """Rows of the maps, None for those of the prediction."""
        return None if self.size is None else map_height(self.size)

    def updated(self, texts: Mapping[str, str]) -> Self:
        """Return the options with the values that `texts` has for some of them; empty texts count as absent.

        Raises `ConfigError` for a text that is no value of its field.
        """
        types = get_type_hints(type(self))
        given = {field.name: texts.get(field.name, "").strip() for field in fields(self)}
        values = {name: parsed(types[name], text, name) for name, text in given.items() if text}
        return replace(self, **values)


@dataclass(frozen=True, kw_only=True)
class PredictRequest(LightOptions):
    """One photo to predict the light of."""

    photo: Path
    """The photo, any format that `lightprobe predict` reads."""
    camera: Path | None = None
    """Camera of the photo, or many of which the photo's name chooses; by default the object is looked for."""
    mask: Path | None = None
    """White object on black, or a folder with a .png for each photo; by default the photo's alpha, or found."""
    name: str | None = None
    """What the photo is called where its file has been renamed, as an upload's is."""
    outputs: tuple[Output, ...] = (Output.EXR, Output.CONFIDENCE)
    """The wanted files."""

    @property
    def mask_file(self) -> Path | None:
        """The photo's own mask, out of the folder if `mask` is one."""
        mask = self.mask
        return mask / f"{self.photo.stem}.png" if mask is not None and mask.is_dir() else mask

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON has them."""
        value: dict[str, Any] = json.loads(json.dumps(asdict(self), default=str))
        return value

    @staticmethod
    def from_json(value: Mapping[str, Any]) -> "PredictRequest":
        """Return the request of which `to_json` gave the value."""
        types = get_type_hints(PredictRequest)
        known = {field.name for field in fields(PredictRequest)} & value.keys()
        return PredictRequest(**{name: _restored(types[name], value[name]) for name in known})


def parsed(kind: Any, text: str, name: str) -> Any:
    """Return the value of a type that a text stands for, of a tuple's type one for each word of the text.

    Raises `ConfigError`, in which `name` is the field's, for a text that is none.
    """
    kind = _some(kind)
    if get_origin(kind) is tuple:
        words = text.replace(",", " ").split()
        return tuple(dict.fromkeys(parsed(get_args(kind)[0], word, name) for word in words))
    word = text.strip().lower()
    if kind is bool:
        if word not in _WORDS:
            raise ConfigError(f"'{name}' must be true or false, not '{shown(text)}'.")
        return _WORDS[word]
    try:
        return kind(word if issubclass(kind, StrEnum) else text)
    except ValueError as error:
        wanted = f"one of {', '.join(kind)}" if issubclass(kind, StrEnum) else "a number"
        raise ConfigError(f"'{name}' must be {wanted}, not '{shown(text)}'.") from error


def json_schema(kind: Any, default: Any = None) -> dict[str, Any]:
    """Return the JSON schema of a field of this type and default."""
    kind = _some(kind)
    if get_origin(kind) is tuple:
        schema = {"type": "array", "items": json_schema(get_args(kind)[0])}
    elif issubclass(kind, StrEnum):
        schema = {"type": "string", "enum": [*kind]}
    else:
        schema = {"type": {bool: "boolean", int: "integer", float: "number"}.get(kind, "string")}
    return schema if default is None else {**schema, "default": default}


@functools.cache
def field_help(kind: type) -> dict[str, str]:
    """Return the docstring of each field of a dataclass and its bases, by the field's name."""
    found = dict[str, str]()
    for one in reversed([one for one in kind.__mro__ if is_dataclass(one)]):
        definition = ast.parse(inspect.getsource(one)).body[0]
        for field, text in pairwise(getattr(definition, "body", [])):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                    found[name] = " ".join(words.split())
    return found


def _some(kind: Any) -> Any:
    """Return the type of a field's values other than None."""
    return get_args(kind)[0] if isinstance(kind, UnionType) else kind


def _restored(kind: Any, value: Any) -> Any:
    kind = _some(kind)
    if value is None:
        return None
    return tuple(map(get_args(kind)[0], value)) if get_origin(kind) is tuple else kind(value)

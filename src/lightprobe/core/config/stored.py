"""Configurations compared as JSON, and back from it with every value of the type that its field has."""

import json
from collections.abc import Mapping
from dataclasses import fields
from enum import Enum
from types import UnionType
from typing import Any, TypeVar, get_args, get_type_hints

from lightprobe.core.errors import ConfigError

Config = TypeVar("Config")


def config_from_json(kind: type[Config], value: Any, what: str) -> Config:
    """Return the dataclass `kind` of a JSON object; absent fields keep their defaults.

    Raises `ConfigError`, in which `what` names the configuration, for an unknown field or a value of another
    type.
    """
    types = get_type_hints(kind)
    if not isinstance(value, Mapping):
        raise ConfigError(f"The stored {what} cannot be used: it is no JSON object.")
    known = {field.name for field in fields(kind)}  # type: ignore[arg-type]  # a dataclass, as documented
    unknown = sorted(set(value) - known)
    if unknown:
        raise ConfigError(f"The stored {what} cannot be used: there is no setting '{unknown[0]}'.")
    return kind(**{name: _typed(types[name], given, f"{what} ({name})") for name, given in value.items()})


def plain(value: Any) -> Any:
    """Return what `value` becomes on its way through a JSON file (tuples turn to lists, for example)."""
    return json.loads(json.dumps(value, allow_nan=False))


def first_difference(stored: Any, given: Any, key: str) -> tuple[str, str, str] | None:
    """Return (path of keys from `key`, stored value, given value) of the first difference, or None."""
    if isinstance(stored, dict) and isinstance(given, dict):
        for name in [*given, *(k for k in stored if k not in given)]:
            found = first_difference(stored.get(name), given.get(name), f"{key}.{name}")
            if found:
                return found
        return None
    return None if stored == given else (key, _brief(stored), _brief(given))


def setting_of_one(stored: Any, given: Mapping[str, Any]) -> str | None:
    """Return the first setting that only one of two configurations has, None where both have the same."""
    return min(set(stored) ^ set(given), default=None) if isinstance(stored, dict) else None


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:20]}...{text[-37:]}"  # of paths the ends differ


def _typed(kind: Any, value: Any, what: str) -> Any:
    """Return a JSON value as the type of its field; whole numbers serve as floats, nothing else is converted."""
    if isinstance(kind, UnionType):  # of a type and None
        return None if value is None else _typed(get_args(kind)[0], value, what)
    if isinstance(kind, type) and issubclass(kind, Enum):
        try:
            return kind(value)
        except ValueError as error:
            raise ConfigError(f"The stored {what} cannot be used: {error}.") from error
    wanted = (int, float) if kind is float else kind
    if kind in (bool, int, float) and (
        not isinstance(value, wanted) or (isinstance(value, bool) and kind is not bool)
    ):
        raise ConfigError(f"The stored {what} cannot be used: {str(value)[:60]!r} is no {kind.__name__}.")
    try:
        return float(value) if kind is float else value
    except OverflowError as error:
        raise ConfigError(f"The stored {what} cannot be used: it is too large a number.") from error

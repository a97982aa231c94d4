"""Configurations: values that are checked, compared as JSON, and read back as the types of their fields."""

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from enum import Enum
from types import UnionType
from typing import Any, TypeVar, get_args, get_type_hints

from lightprobe.core.errors import ConfigError

Config = TypeVar("Config")
LIGHT_RESOLUTIONS = (8, 16, 32, 64, 128, 256)  # texels along each edge of a cubemap

# Settings that older versions wrote and that are constants now.
_GONE = (
    "adam_epsilon brightness_anchor color_gauge final_light_regularisation frequencies hash_features laplacian "
    "intensity_weight late_roughness_prior learning_rate learning_rate_geometry learning_rate_light "
    "learning_rate_material learning_rate_texture light_grey light_regularisation light_solve_iterations "
    "normal_prior_detail parsimony roughness_prior sample_weight sdf_coarse_grids sdf_rate smoothness "
    "smoothness_detail sphere_batch sphere_learning_rate"
)


def check_values(config: Any, section: str, least: Mapping[int, str]) -> None:
    """Refuse numbers of a dataclass that no run could use; raise `ConfigError`.

    least: the fields, separated by blanks, that must have at least the value of their key. Other numbers must
    be 0 or more, and finite, and resolutions those of cubemaps.
    """
    bounds = {name: bound for bound, names in least.items() for name in names.split()}
    for name, value in vars(config).items():
        if isinstance(value, float) and not 0 <= value < math.inf:
            raise ConfigError(f"{section}.{name} must be 0 or more and finite, not {value}.")
        if name in bounds and value < bounds[name]:
            raise ConfigError(f"{section}.{name} must be at least {bounds[name]}, not {value}.")
        if name.endswith("resolution") and value not in LIGHT_RESOLUTIONS:
            raise ConfigError(f"{section}.{name} must be a power of two from 8 to 256, not {value}.")


def config_from_json(kind: type[Config], value: Any, what: str) -> Config:
    """Return the dataclass `kind` of a JSON object; absent fields keep their defaults, former ones are passed
    over.

    Raises `ConfigError`, in which `what` names the configuration, for an unknown field or a value of another
    type.
    """
    types = get_type_hints(kind)
    if not isinstance(value, Mapping):
        raise ConfigError(f"The stored {what} cannot be used: it is no JSON object.")
    known = {field.name for field in fields(kind)}  # type: ignore[arg-type]  # a dataclass, as documented
    unknown = sorted(set(value) - known - set(_GONE.split()))
    if unknown:
        raise ConfigError(f"The stored {what} cannot be used: there is no setting '{unknown[0]}'.")
    kept = {name: given for name, given in value.items() if name in known}
    return kind(**{name: _typed(types[name], given, f"{what} ({name})") for name, given in kept.items()})


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

"""Libraries that only some uses need: imported when they are, and named with a remedy where they are missing."""

import importlib
from pathlib import Path
from typing import Any

from lightprobe.core.errors import ConfigError, InputError


def extra_library(name: str, purpose: str, extra: str = "photos") -> Any:
    """Return the module `name` of an extra; raise `ConfigError` saying that `purpose` needs it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ConfigError(f"{purpose} needs {name}, which is not installed; {_remedy(extra)}") from error


def photo_library(name: str, path: Path) -> Any:
    """Return the module `name` of the extra `photos`; raise `InputError` saying that `path` needs it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        missing = name.partition(".")[0]
        raise InputError(
            f"{path} cannot be read without the library {missing}; {_remedy('photos')}"
        ) from error


def _remedy(extra: str) -> str:
    return f"install it with: pip install 'lightprobe[{extra}]'."

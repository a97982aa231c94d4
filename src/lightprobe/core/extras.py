"""Libraries that only some uses need: imported when they are, and named with a remedy where they are missing."""

import importlib
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError


def photo_library(name: str, path: Path) -> Any:
    """Return the module `name` of the extra `photos`; raise `InputError` naming `path`, the file that needs it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"{path} cannot be read without the library {name.partition('.')[0]}; install it with "
            "`pip install 'lightprobe[photos]'`."
        ) from error

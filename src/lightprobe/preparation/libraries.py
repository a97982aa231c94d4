"""The libraries of `lightprobe[photos]`, imported when they are first needed."""

import importlib
from types import ModuleType

from lightprobe.core.errors import ConfigError

_NEEDED_FOR = {
    "pycolmap": "finding the cameras of plain photos",
    "cv2": "cutting the object out of plain photos",
}


def library(name: str) -> ModuleType:
    """Return the module `pycolmap` or `cv2`; raise `ConfigError` saying how to install it when it is missing."""
    try:
        module = importlib.import_module(name)
    except ImportError as error:
        raise ConfigError(
            f"{_NEEDED_FOR[name].capitalize()} needs {name}, which is not installed; "
            "install it with: pip install 'lightprobe[photos]'."
        ) from error
    if name == "pycolmap":
        module.logging.minloglevel = 4  # what it says is said again in our words
    return module

"""The libraries of `lightprobe[photos]` that preparing needs."""

from typing import Any

from lightprobe.core.extras import extra_library

_SILENT = 4  # beyond glog's FATAL, 3


def pycolmap_library() -> Any:
    """Return `pycolmap`, told to be silent; raise `ConfigError` saying how to install it when it is missing."""
    module = extra_library("pycolmap", "Finding the cameras of plain photos")
    module.logging.minloglevel = _SILENT  # what it says is said again in our words
    return module


def opencv_library() -> Any:
    """Return OpenCV's `cv2`; raise `ConfigError` saying how to install it when it is missing."""
    return extra_library("cv2", "Cutting the object out of plain photos")

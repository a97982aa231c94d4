"""Masks by the package rembg, where the user has installed it with a model of its own."""

import importlib

import numpy as np

from lightprobe.core.errors import ConfigError


def rembg_mask(color: np.ndarray) -> np.ndarray:
    """Return the mask (h, w) bool that rembg finds in a photo (h, w, 3) uint8.

    Raises `ConfigError` where rembg is not installed or gives something else than a mask.
    """
    try:
        rembg = importlib.import_module("rembg")
    except ImportError as error:
        raise ConfigError(
            "--masker rembg needs the package rembg and a model of yours, which are not installed; "
            "install them with: pip install rembg, or leave --masker out."
        ) from error
    mask = np.asarray(rembg.remove(np.ascontiguousarray(color), only_mask=True))
    if mask.shape != color.shape[:2]:
        raise ConfigError(
            "--masker rembg gave no mask of the photo's size; update rembg, or leave --masker out."
        )
    return mask >= 128

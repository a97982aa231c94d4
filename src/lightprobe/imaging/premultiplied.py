"""Colour that a file stores multiplied by its alpha, as renderers and compositors write it."""

import numpy as np

_LEAST_ALPHA = (
    1 / 512
)  # half a step of eight bits: below it a pixel counts as outside, and glows by what is stored


def straight(values: np.ndarray, white: float = 1.0) -> np.ndarray:
    """Return (H, W, C) floats or unsigned integers, 1 at `white`, with colour divided by the alpha in the
    last channel.

    Floats are changed in place where they allow it; C = 1 and C = 3 have no alpha, and are returned as they
    are. Where alpha is next to nothing, colour stays as stored: by OpenEXR's convention it is light that
    covers nothing there. Integers end at `white`.
    """
    if values.shape[2] not in (2, 4):
        return values
    alpha = values[..., -1:]
    covered = alpha > _LEAST_ALPHA * white
    if values.dtype.kind == "f":
        np.divide(values[..., :-1], alpha / white, out=values[..., :-1], where=covered)
        return values
    color = values[..., :-1].astype(np.float64)
    np.divide(color * white, alpha, out=color, where=covered)
    return np.concatenate([np.rint(np.minimum(color, white)).astype(values.dtype), alpha], axis=2)

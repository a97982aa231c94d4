"""The sRGB transfer curve (IEC 61966-2-1), for NumPy arrays and torch tensors alike; and premultiplied colour.

Values below zero follow the curve's straight part and values above one its power part, so both functions are
inverse to each other everywhere and have a finite derivative.
"""

from typing import TypeVar

import numpy as np
import torch

Array = TypeVar("Array", np.ndarray, torch.Tensor)

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)  # weights of linear sRGB (BT.709)
_LINEAR_KNEE = 0.0031308  # of IEC 61966-2-1
_ENCODED_KNEE = 0.04045  # the same, encoded
_LEAST_ALPHA = 1 / 512  # half a step of eight bits: below it a pixel counts as outside


def srgb_encode(linear: Array) -> Array:
    """Return sRGB-encoded values of `linear` (any shape, floating dtype kept)."""
    if isinstance(linear, torch.Tensor):
        # The clamp keeps the unused branch of `where` from sending NaN gradients.
        power = 1.055 * linear.clamp(min=_LINEAR_KNEE) ** (1 / 2.4) - 0.055
        return torch.where(linear <= _LINEAR_KNEE, 12.92 * linear, power)
    power = 1.055 * np.maximum(linear, _LINEAR_KNEE) ** (1 / 2.4) - 0.055
    return np.where(linear <= _LINEAR_KNEE, 12.92 * linear, power)


def srgb_decode(encoded: Array) -> Array:
    """Return linear values of sRGB-`encoded` ones (any shape, floating dtype kept)."""
    if isinstance(encoded, torch.Tensor):
        power = ((encoded.clamp(min=_ENCODED_KNEE) + 0.055) / 1.055) ** 2.4
        return torch.where(encoded <= _ENCODED_KNEE, encoded / 12.92, power)
    power = ((np.maximum(encoded, _ENCODED_KNEE) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= _ENCODED_KNEE, encoded / 12.92, power)


def straight(values: np.ndarray, white: float = 1.0) -> np.ndarray:
    """Return premultiplied (H, W, C), 1 at `white`, with colour divided by the alpha in the last channel.

    C = 1 and C = 3 have no alpha and are returned as they are. Floats are changed in place where they allow
    it; integers end at `white`. Where alpha is next to nothing, colour stays as stored: by OpenEXR's
    convention it is light that covers nothing there.
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

"""What of a photo's colours outlasts a change of light: logarithms, in which light adds instead of
multiplying.

Notation: an appearance has three channels: logarithm of the luma, and the logarithms of red over green and of
blue over green. A light twice as bright adds a constant to the first, a tinted one constants to the others.
"""

import numpy as np
import torch
from torch import Tensor

from lightprobe.light.photometry import luma

_FLOOR = 0.02  # added to linear values: what is darker is noise in a photo whose white is 1


def appearance(linear: Tensor) -> Tensor:
    """Return the appearance (..., 3) of linear colours (..., 3) in which the photo's white is 1."""
    light = linear.clamp(min=0)
    logs = (light + _FLOOR).log()
    tints = logs[..., [0, 2]] - logs[..., 1:2]
    return torch.cat([(luma(light) + _FLOOR).log()[..., None], tints], -1)


def edge_field(picture: np.ndarray, softness: float = 0.1) -> np.ndarray:
    """Return the edges of an appearance (H, W, 3) as (H, W, 2) float32, the cosine and sine of twice their
    direction.

    The length is |g| / (|g| + softness), below 1, g being the strongest channel's gradient per pixel: how
    strong an edge is depends on what happens to stand behind the object, where it runs does not.
    """
    down, across = np.gradient(picture, axis=(0, 1))
    strongest = (down**2 + across**2).argmax(2)[..., None]
    y, x = (np.take_along_axis(part, strongest, 2)[..., 0] for part in (down, across))
    size = np.hypot(x, y)
    double = np.stack([x * x - y * y, 2 * x * y], -1) / np.maximum(size, 1e-9)[..., None] ** 2
    return (double * (size / (size + softness))[..., None]).astype(np.float32)

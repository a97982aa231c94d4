"""What of a photo's colours outlasts a change of light: logarithms, in which light adds instead of
multiplying.

Notation: an appearance has three channels: logarithm of the luma, and the logarithms of red over green and of
blue over green. A light twice as bright adds a constant to the first, a tinted one constants to the others.
"""

import functools
from dataclasses import dataclass

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.imaging import resize_area
from lightprobe.light.photometry import luma
from lightprobe.scene.photo import CLIPPED

_FLOOR = 0.02  # added to linear values: what is darker is noise in a photo whose white is 1
_BLUR = 0.7  # pixels: gradients of neighbours that a step of a pixel still follows


def appearance(linear: Tensor) -> Tensor:
    """Return the appearance (..., 3) of linear colours (..., 3) in which the photo's white is 1."""
    light = linear.clamp(min=0)
    logs = (light + _FLOOR).log()
    tints = logs[..., [0, 2]] - logs[..., 1:2]
    return torch.cat([(luma(light) + _FLOOR).log()[..., None], tints], -1)


def edge_field(picture: np.ndarray, softness: float = 0.1) -> np.ndarray:
    """Return the edges (H, W, 2) float32 of an appearance (H, W, 3): cosine and sine of twice their angle.

    The length is |g| / (|g| + softness), below 1, g being the strongest channel's gradient per pixel: how
    strong an edge is depends on what happens to stand behind the object, where the edge runs does not.
    """
    down, across = np.gradient(picture, axis=(0, 1))
    strongest = (down**2 + across**2).argmax(2)[..., None]
    y, x = (np.take_along_axis(part, strongest, 2)[..., 0] for part in (down, across))
    size = np.hypot(x, y)
    double = np.stack([x * x - y * y, 2 * x * y], -1) / np.maximum(size, 1e-9)[..., None] ** 2
    return (double * (size / (size + softness))[..., None]).astype(np.float32)


@dataclass(frozen=True)
class ScaledPhoto:
    """A photo at one size (h, w); all float32."""

    color: np.ndarray  # (h, w, 3) linear
    clipped: np.ndarray  # (h, w, 3) bool
    gradient: np.ndarray  # (h, w, 3, 2) change of the blurred colour per pixel to the right and down
    appearance: np.ndarray  # (h, w, 3)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.color.shape[1], self.color.shape[0]


class PhotoPyramid:
    """A photo at any size up to its own, each made when it is first asked for."""

    def __init__(self, color: np.ndarray):
        """Take the photo's linear colour (H, W, 3), background included."""
        self.color = np.ascontiguousarray(color, np.float32)
        self.size = self.color.shape[1], self.color.shape[0]  # width and height of the photo in pixels
        self._clipped = (self.color >= CLIPPED).astype(np.float32)
        self._at = functools.cache(self._made)

    def near(self, scale: float) -> ScaledPhoto:
        """Return the photo scaled by about `scale`, at most 1, in steps of a fifth; sizes are kept."""
        step = 0 if scale >= 1 else int(np.ceil(np.log(scale) / np.log(1.2)))
        return self._at(min(step, 0))  # a larger photo has nothing more to show

    def _made(self, step: int) -> ScaledPhoto:
        width, height = (max(8, round(length * 1.2**step)) for length in self.size)
        color = resize_area(self.color, height, width) if step else self.color
        clipped = (resize_area(self._clipped, height, width) if step else self._clipped) > 0
        soft = scipy.ndimage.gaussian_filter(np.minimum(color, 1), (_BLUR, _BLUR, 0))
        gradient = np.stack([np.gradient(soft, axis=1), np.gradient(soft, axis=0)], -1)
        return ScaledPhoto(color, clipped, gradient, appearance(torch.from_numpy(color)).numpy())

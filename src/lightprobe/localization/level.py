"""A photo at the sizes at which a pose is refined: colours, what is clipped, gradients and appearance."""

import functools
from dataclasses import dataclass

import numpy as np
import scipy
import torch

from lightprobe.imaging import resize_area
from lightprobe.localization.appearance import appearance
from lightprobe.scene.photo import CLIPPED

_BLUR = 0.7  # pixels: gradients of neighbours that a step of a pixel still follows


@dataclass(frozen=True)
class Level:
    """A photo at one size (h, w); all float32."""

    color: np.ndarray  # (h, w, 3) linear
    clipped: np.ndarray  # (h, w, 3) bool
    gradient: np.ndarray  # (h, w, 3, 2) change of the blurred colour per pixel to the right and down
    appearance: np.ndarray  # (h, w, 3)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.color.shape[1], self.color.shape[0]


class Levels:
    """A photo at any size up to its own, each made when it is first asked for."""

    def __init__(self, color: np.ndarray):
        """Take the photo's linear colour (H, W, 3), background included."""
        self.color = np.ascontiguousarray(color, np.float32)
        self._clipped = (self.color >= CLIPPED).astype(np.float32)
        self._at = functools.cache(self._made)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the photo in pixels."""
        return self.color.shape[1], self.color.shape[0]

    def near(self, scale: float) -> Level:
        """Return the photo scaled by about `scale`, at most 1: sizes come in steps of a fifth, and are kept."""
        step = 0 if scale >= 1 else int(np.ceil(np.log(scale) / np.log(1.2)))
        return self._at(min(step, 0))  # a larger photo has nothing more to show

    def _made(self, step: int) -> Level:
        width, height = (max(8, round(length * 1.2**step)) for length in self.size)
        color = resize_area(self.color, height, width) if step else self.color
        clipped = (resize_area(self._clipped, height, width) if step else self._clipped) > 0
        soft = scipy.ndimage.gaussian_filter(np.minimum(color, 1), (_BLUR, _BLUR, 0))
        gradient = np.stack([np.gradient(soft, axis=1), np.gradient(soft, axis=0)], -1)
        return Level(color, clipped, gradient, appearance(torch.from_numpy(color)).numpy())

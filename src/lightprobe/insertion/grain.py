"""The grain of a photo: how strong its noise is at each brightness, and new noise like it.

Immerkaer (Fast noise variance estimation, 1996): the kernel (1 -2 1; -2 4 -2; 1 -2 1) leaves nothing of flat and sloped
parts of a picture and six times the deviation of white noise. Of its responses the median within a brightness counts,
which edges and textures in less than half of the pixels do not move. All of displayed values, where grain is
about as strong in the dark as in the light.
"""

from dataclasses import dataclass

import numpy as np
import scipy

_KERNEL = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]]) / 6
_TO_DEVIATION = 1.4826  # of a normal distribution, from the median of its absolute values
_LEVELS = 12  # of brightness
_LEAST = 200  # pixels that tell the noise of a level
_LARGEST = 0.1  # displayed; more is no grain
_CLIPPED = 0.99  # displayed


@dataclass(frozen=True)
class Grain:
    """The deviation of displayed noise at evenly spaced brightnesses from 0 to 1, per channel."""

    deviation: np.ndarray  # (L, 3)

    @staticmethod
    def of(shown: np.ndarray, counted: np.ndarray) -> "Grain":
        """Return the grain of a displayed photo (H, W, 3) in [0, 1], at the pixels `counted` (H, W) bool."""
        levels = np.linspace(0, 1, _LEVELS)
        deviation = np.zeros((_LEVELS, 3))
        counted = scipy.ndimage.binary_erosion(counted)
        for channel in range(3):
            plane = np.asarray(shown[..., channel], np.float64)
            used = counted & (plane < _CLIPPED) & (plane > 1 - _CLIPPED)
            found = np.abs(scipy.ndimage.convolve(plane, _KERNEL, mode="nearest"))[used]
            level = np.rint(scipy.ndimage.uniform_filter(plane, 3)[used] * (_LEVELS - 1)).astype(int)
            known = [k for k in range(_LEVELS) if (level == k).sum() >= _LEAST]
            if known:
                values = [_TO_DEVIATION * np.median(found[level == k]) for k in known]
                deviation[:, channel] = np.interp(levels, levels[known], values)
        return Grain(deviation.clip(0, _LARGEST))

    def add(self, shown: np.ndarray, weight: np.ndarray, seed: int) -> np.ndarray:
        """Return a displayed picture (H, W, 3) with noise of this strength times `weight` (H, W); reproducible."""
        noise = np.random.default_rng(seed).standard_normal(shown.shape)
        levels = np.linspace(0, 1, len(self.deviation))
        strength = np.stack([np.interp(shown[..., k], levels, self.deviation[:, k]) for k in range(3)], -1)
        return shown + noise * strength * weight[..., None]

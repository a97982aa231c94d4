"""The grain of a photo: how strong its noise is at each brightness, and new noise like it.

Immerkaer (Fast noise variance estimation, 1996): the kernel (1 -2 1; -2 4 -2; 1 -2 1) leaves nothing of flat and
sloped parts of a picture and six times the deviation of white noise. The median of its responses within a block of
8 x 8 pixels is the block's noise. Of the blocks of one brightness the calmest count, as others show texture. Values
are displayed ones, in which grain is about as strong in the dark as in the light.
"""

from dataclasses import dataclass

import numpy as np
import scipy

_KERNEL = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]]) / 6
_TO_DEVIATION = 1.4826  # of a normal distribution, from the median of its absolute values
_BLOCK = 8  # pixels
_CALM = 0.1  # quantile of the blocks of a brightness
_CALMER = 0.76  # of white noise, that quantile over the deviation
_LEVELS = 8  # of brightness
_LEAST = 10  # blocks that tell the noise of a level
_LARGEST = 0.1  # displayed; more is no grain
_CLIPPED = 0.99  # displayed


@dataclass(frozen=True)
class Grain:
    """The deviation of displayed noise at evenly spaced brightnesses from 0 to 1, per channel."""

    deviation: np.ndarray  # (L, 3)

    @staticmethod
    def of(displayed: np.ndarray, counted: np.ndarray) -> "Grain":
        """Return the grain of a displayed photo (H, W, 3) in [0, 1], at the pixels `counted` (H, W) bool."""
        levels = np.linspace(0, 1, _LEVELS)
        deviation = np.zeros((_LEVELS, 3))
        used = _blocks(scipy.ndimage.binary_erosion(counted)).all(-1)
        for channel in range(3):
            plane = np.asarray(displayed[..., channel], np.float64)
            own = _blocks(plane)
            free = used & (own.max(-1) < _CLIPPED) & (own.min(-1) > 1 - _CLIPPED)
            response = np.abs(_blocks(scipy.ndimage.convolve(plane, _KERNEL, mode="nearest")))
            noise = np.median(response, -1)[free]
            level = np.rint(own.mean(-1)[free] * (_LEVELS - 1)).astype(int)
            known = [k for k in range(_LEVELS) if (level == k).sum() >= _LEAST]
            if known:
                calm = [_TO_DEVIATION / _CALMER * np.quantile(noise[level == k], _CALM) for k in known]
                deviation[:, channel] = np.interp(levels, levels[known], calm)
        return Grain(deviation.clip(0, _LARGEST))

    def add(self, displayed: np.ndarray, weight: np.ndarray, seed: int) -> np.ndarray:
        """Return a displayed picture (H, W, 3) with reproducible noise of this strength times `weight` (H,
        W).
        """
        noise = np.random.default_rng(seed).standard_normal(displayed.shape)
        levels = np.linspace(0, 1, len(self.deviation))
        known = [np.interp(displayed[..., k], levels, self.deviation[:, k]) for k in range(3)]
        strength = np.stack(known, -1)
        return displayed + noise * strength * weight[..., None]


def _blocks(plane: np.ndarray) -> np.ndarray:
    """Return the whole blocks of a plane (H, W) and the pixels of each, (H // 8, W // 8, 64)."""
    height, width = (length // _BLOCK for length in plane.shape)
    cut = plane[: height * _BLOCK, : width * _BLOCK].reshape(height, _BLOCK, width, _BLOCK)
    return cut.transpose(0, 2, 1, 3).reshape(height, width, _BLOCK**2)

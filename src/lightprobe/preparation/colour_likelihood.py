"""How much likelier a pixel's colour is on the object than in the background, by where colours lie in the photo.

Densities are in units of the kernel's peak: 1 where everything nearby has the colour, _NOVEL for a colour of which
nothing is known. What is known of neither side is likelier the object: the background is all around and seen whole,
of the object only a part is known at first.
"""

import numpy as np

from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.support_plane import Expected

SURE = 6.0  # logarithm beyond which a pixel is not surer: reflections and clipped whites deceive any model
_KINDS = 32  # of colours in a photo
_SAMPLES = 6000  # pixels that these are found from
_ROUNDS = 8  # of k-means
_ALIKE = 10.0  # deviation of 8-bit CIELAB within which colours are the same
_STRANGE = 0.135  # likeness to all kinds together, two deviations from one, below which a colour counts less
_NOVEL = 0.004  # of the kernel's peak: (2 pi)^(3/2) _ALIKE^3 over the volume of sRGB in 8-bit CIELAB
_NEARBY = 0.7  # of the density is of what lies nearby, the rest of the whole photo
_KNOWN = 0.95  # of the background's pixels have a colour that the background has elsewhere
_PLANE = 0.8  # of the background's pixels that show the plane have the colour that is expected there
_SHARPEST = 4.0  # density of a colour that is expected, at most
_SMOOTH = 0.7  # pixels over which the answer is averaged: noise of single pixels


def colour_kinds(colors: np.ndarray, most: int, samples: int) -> np.ndarray:
    """Return at most so many kinds (K, 3) of colours (N, 3) float32, by k-means of some `samples` of them."""
    cv2 = opencv_library()
    some = colors[:: max(1, len(colors) // samples)]
    end = cv2.TERM_CRITERIA_MAX_ITER, _ROUNDS, 0.0
    cv2.setRNGSeed(0)
    return cv2.kmeans(some, min(most, len(some)), None, end, 1, cv2.KMEANS_PP_CENTERS)[2]


def nearby(values: np.ndarray, reach: float) -> np.ndarray:
    """Return the mean of values (h, w) float32 around each pixel, by a Gaussian of `reach` pixels' deviation."""
    cv2 = opencv_library()
    height, width = values.shape
    step = max(1, int(reach / 4))  # what is so smooth is found on a coarser grid
    small = max(1, width // step), max(1, height // step)
    coarse = cv2.resize(values, small, interpolation=cv2.INTER_AREA)
    return cv2.resize(cv2.GaussianBlur(coarse, (0, 0), reach / step), (width, height))


class ColourLikelihood:
    """A photo's colours, sorted into kinds."""

    def __init__(self, color: np.ndarray):
        """Find the kinds of colours of a photo (h, w, 3) uint8 sRGB."""
        cv2 = opencv_library()
        self.lab = cv2.cvtColor(color, cv2.COLOR_RGB2LAB).astype(np.float32)
        self._kinds = colour_kinds(self.lab.reshape(-1, 3), _KINDS, _SAMPLES)

    def log_ratio(
        self,
        inside: np.ndarray,
        outside: np.ndarray,
        reach: float,
        novel: float,
        expected: Expected | None = None,
    ) -> np.ndarray:
        """Return ln p(colour | object) - ln p(colour | background) of each pixel, (h, w) float32.

        inside, outside: (h, w) bool, pixels that show the object and the background. reach: pixels, the deviation
        with which pixels farther away count less. novel: share of the object that may have any colour. expected:
        what the support plane would show.
        """
        cv2 = opencv_library()
        differences = (self.lab - kind for kind in self._kinds)
        alike = np.stack([np.exp((off * off).sum(-1) / np.float32(-2 * _ALIKE**2)) for off in differences])
        share = alike / np.maximum(alike.sum(0), _STRANGE)  # what is like none of them is undecided
        on, off = (_density(alike, share, side, reach) for side in (inside, outside))
        on, off = (1 - novel) * on + novel * _NOVEL, _KNOWN * off + (1 - _KNOWN) * _NOVEL
        if expected is not None:
            strange = expected.off(self.lab) / expected.deviation
            peak = np.minimum((_ALIKE / expected.deviation) ** 3, _SHARPEST)
            there = (1 - _PLANE) * off + _PLANE * peak * np.exp(-0.5 * strange * strange)
            off = np.where(expected.known, there, off)
        ratio = cv2.GaussianBlur((np.log(on) - np.log(off)).astype(np.float32), (0, 0), _SMOOTH)
        return np.clip(ratio, -SURE, SURE)


def _density(alike: np.ndarray, share: np.ndarray, side: np.ndarray, reach: float) -> np.ndarray:
    """Return the density of each pixel's colour among the pixels of `side` (h, w), (h, w) float32.

    alike, share (kinds, h, w): how alike pixels are to a kind of colour, and how much of theirs is of the kind.
    """
    if not side.any():
        return np.zeros(side.shape, np.float32)
    weight = side.astype(np.float32)
    total = nearby(weight, reach)
    near = sum(part * nearby(each * weight, reach) for part, each in zip(share, alike, strict=True))
    whole = np.tensordot((alike * weight).sum((1, 2)) / weight.sum(), share, 1)
    trust = _NEARBY * total / (total + 0.02)  # nothing lies nearby: the whole photo tells
    return trust * near / np.maximum(total, 1e-6) + (1 - trust) * whole

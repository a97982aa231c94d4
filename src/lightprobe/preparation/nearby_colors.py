"""Which side of an outline a pixel belongs to, by the colours that are near it on either side.

Models of all the object's and all the surroundings' colours confuse a rim with whatever has its colour
elsewhere in the photo; what lies next to it tells them apart.
"""

import numpy as np

from lightprobe.preparation.libraries import opencv_library

_KINDS = 24  # of colours
_SAMPLES = 4000  # pixels at least that these are found from, where there are as many
_ROUNDS = 8  # of k-means
_ALIKE = 14.0  # deviation of 8-bit CIELAB within which colours are the same
_STRANGE = 0.135  # likeness to all kinds together, two deviations from one, below which a colour counts less
_UNLIKELY = 0.01  # likeness that a colour has with none of its surroundings
_SMOOTH = 0.7  # pixels over which the answer is averaged: noise of single pixels


def likelier_inside(color: np.ndarray, inside: np.ndarray, outside: np.ndarray, reach: float) -> np.ndarray:
    """Return how much likelier the colour of each pixel is `inside` than `outside`, the natural logarithm,
    (h, w).

    color: (h, w, 3) uint8 sRGB. inside, outside: (h, w) bool, pixels whose side is known. reach: pixels, the
    deviation with which those that are farther away count less. Nearly 0 where either has none within some
    times that, or the colour is like neither's.
    """
    cv2 = opencv_library()
    lab = cv2.cvtColor(color, cv2.COLOR_RGB2LAB).astype(np.float32)
    known = lab[inside | outside]
    if not inside.any() or not outside.any() or len(known) < _KINDS:
        return np.zeros(color.shape[:2], np.float32)
    cv2.setRNGSeed(0)
    end = cv2.TERM_CRITERIA_MAX_ITER, _ROUNDS, 0.0
    kinds = cv2.kmeans(known[:: max(1, len(known) // _SAMPLES)], _KINDS, None, end, 1, cv2.KMEANS_PP_CENTERS)[
        2
    ]
    alike = np.stack([_alike(lab, kind) for kind in kinds])
    share = alike / np.maximum(alike.sum(0), _STRANGE)  # what is like none of them is undecided
    height, width = color.shape[:2]
    step = max(1, int(reach / 4))  # what is so smooth is found on a coarser grid
    small = max(1, width // step), max(1, height // step)

    def around(values: np.ndarray) -> np.ndarray:
        coarse = cv2.resize(values, small, interpolation=cv2.INTER_AREA)
        return cv2.resize(cv2.GaussianBlur(coarse, (0, 0), reach / step), (width, height))

    logarithms, far = [], np.zeros((height, width), bool)
    for side in (inside, outside):
        weight = side.astype(np.float32)
        total = around(weight)
        likeness = sum(part * around(each * weight) for part, each in zip(share, alike, strict=True))
        logarithms.append(np.log(likeness / np.maximum(total, 1e-6) + _UNLIKELY))
        far |= total < 1e-3
    return cv2.GaussianBlur(np.where(far, 0.0, logarithms[0] - logarithms[1]), (0, 0), _SMOOTH)


def _alike(lab: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Return how alike each pixel (h, w, 3) float32 is to a colour (3,), (h, w) float32 from 0 to 1."""
    lightness, a, b = (lab[..., channel] - kind[channel] for channel in range(3))
    return np.exp((lightness * lightness + a * a + b * b) / np.float32(-2 * _ALIKE**2))

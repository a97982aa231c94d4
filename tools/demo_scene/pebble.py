"""A pebble of one even material: nothing on it tells where a photo was taken from but its outline and its
shading.
"""

import numpy as np

from .geometry import Part, normalise, rounded_box
from .textures import Canvas, Material, Painters

_CELADON = np.array([0.33, 0.45, 0.36])  # linear
_ROUGHNESS = 0.3


def pebble() -> list[Part]:
    """Return the pebble: an ellipsoid with one thick end, a bend and a dent, so that no view looks like
    another.
    """
    return normalise([rounded_box("pebble", 2.0, (56, 72), _bent)])


def _bent(points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    thick = 1 + 0.30 * x - 0.12 * x**2
    dent = 1 - 0.16 * np.exp(-((x - 0.35) ** 2 + (y - 0.9) ** 2 + (z - 0.2) ** 2) / 0.30)
    bend = 0.20 * x**2 + 0.10 * x * y
    return np.stack([0.95 * x * dent, 0.64 * y * thick * dent, 0.46 * z * thick * dent + bend], 1)


def _paint(c: Canvas, seed: int) -> Material:
    even = np.ones_like(c.u)
    return Material(_CELADON * even[..., None], _ROUGHNESS * even, 0.0 * even)


PEBBLE_PAINTERS: Painters = {"pebble": _paint}

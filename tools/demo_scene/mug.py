"""A mug with a handle: a deep cavity, which no mask shows. Notation as in `geometry`; base colours are
linear.
"""

import numpy as np

from .dark_paints import band, finish
from .geometry import Part, normalise, revolve, smooth, sweep
from .noise import smoothstep
from .textures import Canvas, Material, Painters

_GLAZE = np.array([0.05, 0.20, 0.17])
_CLAY = np.array([0.42, 0.24, 0.14])
_CREAM = np.array([0.70, 0.64, 0.50])


def mug() -> list[Part]:
    """Return the mug, its wall a twelfth of its radius, and its handle."""
    return normalise([_body(), _handle()])


def _body() -> Part:
    foot = [np.array([[0.0, 0.03], [0.38, 0.025]]), np.array([[0.38, 0.025], [0.41, 0.0]])]
    side = smooth([(0.41, 0.0), (0.47, 0.02), (0.52, 0.15), (0.55, 0.50), (0.55, 1.0)], 31)
    lip = smooth([(0.55, 1.0), (0.547, 1.025), (0.53, 1.035), (0.512, 1.025), (0.506, 1.0)], 9)
    inside = smooth(
        [(0.506, 1.0), (0.505, 0.50), (0.47, 0.18), (0.36, 0.085), (0.18, 0.075), (0.0, 0.075)], 35
    )
    return revolve("body", [*foot, side, lip, inside], 64)


def _handle() -> Part:
    path = smooth(
        [
            (0.53, 0, 0.86),
            (0.70, 0, 0.87),
            (0.83, 0, 0.76),
            (0.84, 0, 0.52),
            (0.74, 0, 0.30),
            (0.53, 0, 0.22),
        ],
        33,
    )
    return sweep("handle", path, np.full((33, 2), [0.045, 0.07]), 18)


def _paint_body(c: Canvas, seed: int) -> Material:
    """Bare clay below, green glaze with a cream belt around the outside, cream within."""
    outside = finish(c, _GLAZE, 0.22, 0.0, seed).over(
        finish(c, _CLAY, 0.75, 0.0, seed + 1), smoothstep(0.20, 0.205, c.v)
    )
    belt = band(c.v, 0.40, 0.44)
    return finish(c, _CREAM, 0.24, 0.0, seed + 2).over(
        outside, np.maximum(belt, smoothstep(0.495, 0.50, c.v))
    )


MUG_PAINTERS: Painters = {"body": _paint_body, "handle": lambda c, seed: finish(c, _GLAZE, 0.22, 0.0, seed)}

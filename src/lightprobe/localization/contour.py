"""The outline of the object at a pose, and how far from it the photo has an edge of the object.

Across the outline at a point with outward normal n, k pixels out, the photo's appearance steps by

    h(k) = | mean a(k + 1, k + 2) - mean a(k - 1, k - 2) |

An edge is the object's if the inside looks as the object does there, in appearance o, under the light found
so far:

    support(k) = h / (h + softness) exp(-|mean a(k - 1, k - 2) - o|^2 / 2 tolerance^2)
"""

from dataclasses import dataclass

import numpy as np
import scipy

from lightprobe.localization.level import Level
from lightprobe.scene.contact_sheet import outline

_SOFTNESS = 0.15  # of appearance: a step of this size counts half
_TOLERANCE = 0.5  # of appearance, between the object under a coarse light and the photo


@dataclass(frozen=True)
class Outline:
    """Points on the rendered outline; in pixels of a level."""

    row: np.ndarray  # (M,) int64 rows of the G-buffer, the object's pixels along the outline
    place: np.ndarray  # (M, 2) x and y of the outline
    normal: np.ndarray  # (M, 2) unit, outward


def outline_of(pixel: np.ndarray, width: int, height: int, count: int) -> Outline:
    """Return at most `count` points of the outline of the row-major object pixels (P,), ascending, spread
    over it.
    """
    mask = np.zeros(width * height, bool)
    mask[pixel] = True
    shape = mask.reshape(height, width)
    rim = outline(shape)
    soft = scipy.ndimage.gaussian_filter(shape.astype(np.float32), 1.5)
    down, across = np.gradient(soft)
    flat = np.flatnonzero(rim)
    normal = -np.stack([across.ravel()[flat], down.ravel()[flat]], 1)
    length = np.linalg.norm(normal, axis=1)
    sound = np.flatnonzero(length > 0.02)
    sound = sound[np.linspace(0, len(sound) - 1, min(count, len(sound))).astype(int)] if len(sound) else sound
    flat, normal = flat[sound], normal[sound] / length[sound, None]
    center = np.stack([flat % width, flat // width], 1) + 0.5
    return Outline(np.searchsorted(pixel, flat), center + 0.5 * normal, normal)


def edge_support(level: Level, outline: Outline, object_appearance: np.ndarray, reach: int) -> np.ndarray:
    """Return the support (M, 2 reach + 1) of edges at -reach..reach pixels from the outline.

    object_appearance: (M, 3) of the object at the outline's points.
    """
    steps = np.arange(-reach - 2, reach + 3)
    at = outline.place[:, None] + steps[None, :, None] * outline.normal[:, None] - 0.5
    where = [at[..., 1].ravel(), at[..., 0].ravel()]
    seen = np.stack(
        [
            scipy.ndimage.map_coordinates(level.appearance[..., c], where, order=1, mode="nearest")
            for c in range(3)
        ],
        -1,
    ).reshape(*at.shape[:2], 3)
    inside = 0.5 * (seen[:, :-4] + seen[:, 1:-3])
    outside = 0.5 * (seen[:, 3:-1] + seen[:, 4:])
    jump = np.linalg.norm(outside - inside, axis=2)
    off = ((inside - object_appearance[:, None]) ** 2).sum(2)
    return jump / (jump + _SOFTNESS) * np.exp(-0.5 * off / _TOLERANCE**2)


def nearest_edges(support: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distance in pixels and weight, each (M,), of the best edge across each point of the outline.

    support: (M, 2 reach + 1) of `edge_support`; far edges have to be stronger than near ones.
    """
    reach = support.shape[1] // 2
    steps = np.arange(-reach, reach + 1)
    pull = support * np.exp(-0.5 * (steps / max(0.7 * reach, 1)) ** 2)
    best = pull.argmax(1)
    rows = np.arange(len(support))
    inner = best.clip(1, 2 * reach - 1)
    low, mid, high = (support[rows, inner + k] for k in (-1, 0, 1))
    bend = low - 2 * mid + high
    fine = np.where(bend < -1e-6, 0.5 * (low - high) / np.minimum(bend, -1e-6), 0).clip(-0.5, 0.5)
    return inner - reach + fine, support[rows, best]

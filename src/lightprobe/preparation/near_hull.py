"""A mask cut anew around the hull of all masks: where its outline may be, what decides there, and what is
known.

From a margin beyond the hull's outline to one and a half within it these decide, the later over the earlier:
what the mask was, the colours nearby, points that the photo itself saw. An opening that is looked through
counts in all of the hull, the user's hint everywhere.
"""

import numpy as np
import scipy

from lightprobe.preparation.cutting import BACKGROUND, MAYBE_BACKGROUND, MAYBE_OBJECT, OBJECT, cut
from lightprobe.preparation.masks import View, away_from, seen_by
from lightprobe.preparation.nearby_colors import likelier_inside
from lightprobe.preparation.solution import Solution

_DEEP = 1.5  # margins inside the hull from which a pixel is surely the object
_LIKELIER = 1.0  # logarithm of how much likelier a colour is on one side from which a pixel belongs there
_EXACT_POINT = 1.0  # pixels of mean error up to which a point marks its pixel
_MARK = 1.5  # pixels around a point that it marks


def point_marks(
    view: View, solution: Solution, labels: np.ndarray, photo: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return where points that this photo itself saw show the object, and where its surroundings, (h, w) bool
    each.

    labels (P,): of the points, as from `masks.object_points`.
    """
    mine = seen_by(solution, [photo]) & (solution.errors <= _EXACT_POINT)
    on, off = (away_from(view.camera, solution.points[mine & (labels == label)]) < _MARK for label in (1, -1))
    return on, off & ~on


def rim(shape: np.ndarray, margin: float) -> float:
    """Return how many pixels `margin` of the size of the object are, whose hull shows as `shape` (h, w) bool."""
    return max(2.0, margin * float(np.sqrt(shape.sum())))


def cut_near_hull(
    view: View,
    shape: np.ndarray,
    mask: np.ndarray,
    margin: float,
    opening: np.ndarray | None = None,
    marks: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """Return the mask (h, w) bool cut anew within `margin` of the object's size around the hull's `shape` (h,
    w).

    opening: where the photo seems to look through the hull, (h, w) bool; there and around it the colours
    decide. marks: of points, as from `point_marks`.
    """
    if view.fixed and view.given is not None:
        return view.given
    if not shape.any():
        return mask
    width = rim(shape, margin)
    within = scipy.ndimage.distance_transform_edt(np.pad(shape, 1, mode="edge"))[1:-1, 1:-1]
    beyond = scipy.ndimage.distance_transform_edt(~shape)
    trimap = np.where(mask, MAYBE_OBJECT, MAYBE_BACKGROUND).astype(np.uint8)
    trimap[within > width] = MAYBE_OBJECT
    trimap[within > _DEEP * width] = OBJECT
    trimap[beyond > width] = BACKGROUND
    open_to_doubt = (within <= _DEEP * width) & (beyond <= width)
    deep = within > width if opening is None else (within > width) & ~opening
    likelier = likelier_inside(view.color, deep, beyond > width, width)
    trimap[open_to_doubt & (likelier > _LIKELIER)] = OBJECT
    trimap[open_to_doubt & (likelier < -_LIKELIER)] = BACKGROUND
    if marks is not None:
        trimap[open_to_doubt & marks[0]] = OBJECT
        trimap[open_to_doubt & marks[1]] = BACKGROUND
    if opening is not None and opening.any():
        beside = scipy.ndimage.distance_transform_edt(~opening) < width
        trimap[beside & (trimap == OBJECT)] = MAYBE_OBJECT
        trimap[opening & (trimap == MAYBE_OBJECT)] = MAYBE_BACKGROUND
    if view.given is not None:  # a hint that may be coarse: surely where it and the hull agree
        trimap[view.given & shape] = OBJECT
        trimap[~view.given] = BACKGROUND
    return cut(view.color, trimap)

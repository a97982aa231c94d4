"""A mask cut anew around the hull of all masks: where its outline may be, what decides there, and what is
known.

From a margin beyond the hull's outline to one and a half within it these decide, the later over the earlier:
the mask so far, the colours nearby, points that the photo itself saw. An opening that is looked through
counts in all of the hull, the user's hint everywhere. Models of all the object's and all the background's
colours confuse a rim with whatever has its colour elsewhere in the photo; what lies next to the rim tells
them apart.
"""

import numpy as np
import scipy

from lightprobe.preparation.colour_likelihood import colour_kinds, nearby
from lightprobe.preparation.cutting import BACKGROUND, MAYBE_BACKGROUND, MAYBE_OBJECT, OBJECT, cut
from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.mapping import Solution
from lightprobe.preparation.masks import View, away_from, seen_by

_KINDS = 24  # of colours
_SAMPLES = 4000  # pixels at least that these are found from, where there are as many
_ALIKE = 14.0  # deviation of 8-bit CIELAB within which colours are the same
_STRANGE = 0.135  # likeness to all kinds together, two deviations from one, below which a colour counts less
_UNLIKELY = 0.01  # likeness of a colour that nothing nearby has
_SMOOTH = 0.7  # pixels over which the answer is averaged: noise of single pixels
_DEEP = 1.5  # margins inside the hull from which a pixel is surely the object
_LIKELIER = 1.0  # logarithm of how much likelier a colour is on one side from which a pixel belongs there
_EXACT_POINT = 1.0  # pixels of mean error up to which a point marks its pixel
_MARK = 1.5  # pixels around a point that it marks


def likelier_inside(color: np.ndarray, inside: np.ndarray, outside: np.ndarray, reach: float) -> np.ndarray:
    """Return ln of how much likelier the colour of each pixel is `inside` than `outside`, (h, w).

    color: (h, w, 3) uint8 sRGB. inside, outside: (h, w) bool, pixels whose side is known. reach: pixels, the
    deviation with which pixels farther away count less. Nearly 0 where either side has none within some times
    that, or the colour is like neither's.
    """
    cv2 = opencv_library()
    lab = cv2.cvtColor(color, cv2.COLOR_RGB2LAB).astype(np.float32)
    known = lab[inside | outside]
    if not inside.any() or not outside.any() or len(known) < _KINDS:
        return np.zeros(color.shape[:2], np.float32)
    alike = np.stack([_alike(lab, kind) for kind in colour_kinds(known, _KINDS, _SAMPLES)])
    share = alike / np.maximum(alike.sum(0), _STRANGE)  # what is like none of them is undecided
    logarithms, far = [], np.zeros(color.shape[:2], bool)
    for side in (inside, outside):
        weight = side.astype(np.float32)
        total = nearby(weight, reach)
        likeness = sum(part * nearby(each * weight, reach) for part, each in zip(share, alike, strict=True))
        logarithms.append(np.log(likeness / np.maximum(total, 1e-6) + _UNLIKELY))
        far |= total < 1e-3
    return cv2.GaussianBlur(np.where(far, 0.0, logarithms[0] - logarithms[1]), (0, 0), _SMOOTH)


def _alike(lab: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Return how alike each pixel (h, w, 3) float32 is to a colour (3,), (h, w) float32 from 0 to 1."""
    lightness, a, b = (lab[..., channel] - kind[channel] for channel in range(3))
    return np.exp((lightness * lightness + a * a + b * b) / np.float32(-2 * _ALIKE**2))


def point_marks(
    view: View, solution: Solution, labels: np.ndarray, photo: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return where points that this photo itself saw show the object, and where the background, (h, w) bool.

    labels (P,): of the points, as from `masks.object_points`.
    """
    mine = seen_by(solution, [photo]) & (solution.errors <= _EXACT_POINT)
    on, off = (away_from(view.camera, solution.points[mine & (labels == label)]) < _MARK for label in (1, -1))
    return on, off & ~on


def rim(shape: np.ndarray, margin: float) -> float:
    """Return how many pixels `margin` of the object's size are, by the hull's `shape` (h, w) bool."""
    return max(2.0, margin * float(np.sqrt(shape.sum())))


def cut_near_hull(
    view: View,
    shape: np.ndarray,
    mask: np.ndarray,
    margin: float,
    opening: np.ndarray | None = None,
    marks: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """Return the mask (h, w) bool cut anew within `margin` of the object's size around `shape` (h, w).

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

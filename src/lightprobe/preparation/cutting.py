"""The object cut out of one photo: graph cut with colour models of this photo, between what is known for
sure.

A trimap holds one of four labels for each pixel, OpenCV's: surely or probably background or object.
"""

import importlib
from collections.abc import Callable, Iterable

import numpy as np
import scipy

from lightprobe.core.errors import ConfigError
from lightprobe.core.threads import in_threads
from lightprobe.preparation.features import opencv_library

BACKGROUND, OBJECT, MAYBE_BACKGROUND, MAYBE_OBJECT = range(4)  # OpenCV's GC_BGD, GC_FGD, GC_PR_BGD, GC_PR_FGD
_ROUNDS = 3  # of fitting colours and cutting
_SMALLEST = 0.02  # of the largest piece's pixels: smaller pieces and holes are noise


def cut(color: np.ndarray, trimap: np.ndarray) -> np.ndarray:
    """Return the object (h, w) bool in a photo (h, w, 3) uint8, by a trimap (h, w) uint8.

    Where the trimap has no object or no background at all, it is the answer. Raises `ConfigError` without
    OpenCV.
    """
    cv2 = opencv_library()
    box = _box(trimap != BACKGROUND)
    if box is None:
        return np.zeros(trimap.shape, bool)
    labels = np.ascontiguousarray(trimap[box])
    if (labels != BACKGROUND).all() or not (labels & 1).any():
        return (trimap & 1).astype(bool)
    cv2.setRNGSeed(0)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    picture = np.ascontiguousarray(color[box][..., ::-1])
    cv2.grabCut(picture, labels, None, *models, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    mask = np.zeros(trimap.shape, bool)
    mask[box] = (labels & 1).astype(bool)
    return tidy(mask)


def masks_of(work: Callable[[int], np.ndarray], photos: Iterable[int]) -> dict[int, np.ndarray]:
    """Return the mask (h, w) bool that `work` makes of each photo, several at a time in threads.

    Results do not depend on the number of threads, as each photo has random numbers of its own, seeded before
    use. As for `in_threads`, Numba's loops are not for `work`.
    """
    each = list(photos)
    return dict(zip(each, in_threads(work, each), strict=True))


def tidy(mask: np.ndarray) -> np.ndarray:
    """Return a mask (h, w) bool without specks and pinholes."""
    for value in (True, False):
        pieces, count = scipy.ndimage.label(mask == value)
        if count > 1:
            sizes = np.bincount(pieces.ravel())
            sizes[0] = 0
            largest = max(sizes.max(), mask.sum())
            small = (sizes < _SMALLEST * largest) & (sizes > 0)
            mask = np.where(small[pieces], not value, mask)
    return mask


def _box(chosen: np.ndarray) -> tuple[slice, slice] | None:
    """Return the rows and columns around the chosen pixels (h, w), with a margin of background."""
    if not chosen.any():
        return None
    rows, columns = np.flatnonzero(chosen.any(axis=1)), np.flatnonzero(chosen.any(axis=0))
    margin = max(4, int(0.25 * max(np.ptp(rows), np.ptp(columns))))  # as wide as a quarter of the object
    top, left = max(rows[0] - margin, 0), max(columns[0] - margin, 0)
    return slice(top, rows[-1] + margin + 1), slice(left, columns[-1] + margin + 1)


def rembg_mask(color: np.ndarray) -> np.ndarray:
    """Return the mask (h, w) bool that rembg finds in a photo (h, w, 3) uint8.

    Raises `ConfigError` where rembg is not installed or gives something else than a mask.
    """
    try:
        rembg = importlib.import_module("rembg")
    except ImportError as error:
        raise ConfigError(
            "--masker rembg needs the package rembg and a model of yours, which are not installed; "
            "install them with: pip install rembg, or leave --masker out."
        ) from error
    mask = np.asarray(rembg.remove(np.ascontiguousarray(color), only_mask=True))
    if mask.shape != color.shape[:2]:
        raise ConfigError(
            "--masker rembg gave no mask of the photo's size; update rembg, or leave --masker out."
        )
    return mask >= 128

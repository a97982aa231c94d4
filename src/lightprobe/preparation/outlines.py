"""Masks of photos: silhouettes of the object's voxels, with outlines that follow edges of the photo."""

import numpy as np
import scipy

from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.minimum_cut import minimum_cut
from lightprobe.preparation.voxel_labelling import View, away, depth_inside, photo_weight
from lightprobe.scene.consistency import overlap

_STEPS = 40  # of the cut in a photo
_EDGE = 4.0  # cost of a pixel's side along the outline where colours are even
_CONTRAST = 8.0  # 8-bit CIELAB: difference between neighbours where an outline costs half as much
_FREE = 0.1  # of that cost remains at a strong edge
_SLOPE = 0.5  # logarithm by which a pixel is likelier inside for each pixel to the volume's outline
_FAR, _BOUND = 6.0, 3.0  # logarithms that the outline is worth at most, outside and inside
_WIDER = 0.5  # pixels by which silhouettes are too wide


def outlined_mask(view: View, evidence: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Return a photo's mask (h, w) bool: the one that is given and stays as it is, or the one that is found.

    evidence: L (h, w) of the photo. shape (h, w) bool: the voxels' silhouette.
    """
    if view.fixed and view.given is not None:
        return view.given
    return edge_cut(view.color, photo_weight(view, evidence, shape) * evidence, shape)


def stability(mask: np.ndarray, shape: np.ndarray, widest: np.ndarray) -> float:
    """Return how little a mask (h, w) depends on how photos are weighed: 1 not at all, 0 where it shows no voxel.

    shape, widest (h, w) bool: the silhouettes of the voxels, and of those that votes for the object would make if they
    counted three times. The lower IoU of the silhouette with the mask, and with the widest.
    """
    return min(overlap(mask, shape), overlap(widest, shape)) if shape.any() else 0.0


def edge_cut(color: np.ndarray, evidence: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Return the mask (h, w) bool near the volume's silhouette `shape` (h, w) bool, along edges of the photo.

    color: (h, w, 3) uint8 sRGB. evidence: L (h, w).
    """
    if not shape.any():
        return shape
    distance = np.where(shape, depth_inside(shape) - 0.5, 0.5 - away(shape)) - _WIDER
    evidence = evidence + np.clip(_SLOPE * distance, -_FAR, _BOUND)
    cost = outline_cost(color)
    rows, columns = (np.flatnonzero((distance > -_FAR / _SLOPE).any(axis=axis)) for axis in (1, 0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    mask = np.zeros(shape.shape, bool)
    mask[window] = minimum_cut(evidence[window], cost[window], _STEPS)
    filled = scipy.ndimage.binary_fill_holes(mask) & shape  # what the volume fills is a spot, no opening
    return mask | filled


def outline_cost(color: np.ndarray) -> np.ndarray:
    """Return what an outline costs at each pixel of a photo (h, w, 3) uint8 sRGB, (h, w): less along edges."""
    lab = opencv_library().cvtColor(color, opencv_library().COLOR_RGB2LAB).astype(np.float32)
    down, right = np.zeros(lab.shape[:2]), np.zeros(lab.shape[:2])
    down[:-1], right[:, :-1] = (np.diff(lab, axis=0) ** 2).sum(-1), (np.diff(lab, axis=1) ** 2).sum(-1)
    return _EDGE * (_FREE + (1 - _FREE) * np.exp(-(down + right) / (2 * _CONTRAST**2)))

"""Points of a photo that can be found again in another, and descriptors that compare how they look around.

SIFT (Lowe 2004) of the photo's log luma, in which a shadow's edge is as strong on dark parts as on bright
ones; descriptors as square roots of their shares (Arandjelovic & Zisserman 2012). They outlast smooth changes
of light; reflections they do not.
"""

from dataclasses import dataclass
from types import ModuleType

import numpy as np
import torch

from lightprobe.core.extras import extra_library
from lightprobe.imaging import shrink_area
from lightprobe.localization.appearance import appearance

SIDE = 640  # pixels of the longer side that points are looked for at; smaller photos are magnified for finer points
_MAGNIFY = 2.0  # at most: beyond, there is nothing new
_CONTRAST = 0.04  # of SIFT's points, its usual value: fainter ones drown in the noise of dark photos
_LOW, _HIGH = -4.0, 0.1  # range of log luma that is shown
_ERODED = 5  # pixels: features of a masked photo keep this far from the outline, where the background begins


@dataclass(frozen=True)
class Features:
    """N points of a photo."""

    place: np.ndarray  # (N, 2) float32 x and y in pixels of the photo
    descriptor: np.ndarray  # (N, 128) uint8, 255 times the square root of the shares


def load_opencv() -> ModuleType:
    """Return the module `cv2`, or raise `ConfigError` saying how to install it."""
    return extra_library("cv2", "Finding the camera of a photo")


def find_features(color: np.ndarray, count: int, mask: np.ndarray | None = None) -> Features:
    """Return at most `count` of the strongest features of a linear photo (H, W, 3), inside `mask` (H, W) bool
    if given.

    Raises `ConfigError` without OpenCV.
    """
    cv2 = load_opencv()
    small = shrink_area(color, SIDE)
    height, width = small.shape[:2]
    scale = min(_MAGNIFY, SIDE / max(height, width))
    picture = _shown(small)
    if scale > 1:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    inside = None
    if mask is not None:
        inside = cv2.resize(mask.astype(np.uint8) * 255, picture.shape[::-1], interpolation=cv2.INTER_AREA)
        inside = cv2.erode((inside > 250).astype(np.uint8) * 255, np.ones((_ERODED, _ERODED), np.uint8))
    points, descriptors = cv2.SIFT_create(contrastThreshold=_CONTRAST).detectAndCompute(picture, inside)
    if descriptors is None:
        return Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8))
    strongest = np.argsort([-point.response for point in points], kind="stable")[:count]
    to_photo = np.array([color.shape[1] / picture.shape[1], color.shape[0] / picture.shape[0]])
    place = (np.array([points[i].pt for i in strongest]) + 0.5) * to_photo
    share = descriptors[strongest] / np.maximum(descriptors[strongest].sum(1, keepdims=True), 1e-6)
    return Features(place.astype(np.float32), np.rint(255 * np.sqrt(share)).astype(np.uint8))


def _shown(color: np.ndarray) -> np.ndarray:
    """Return log luma as grey, (H, W) uint8."""
    logs = appearance(torch.from_numpy(np.ascontiguousarray(color)))[..., 0].numpy()
    return (np.clip((logs - _LOW) / (_HIGH - _LOW), 0, 1) * 255).astype(np.uint8)

"""What an opaque photo shows around the object: part of the light itself, seen directly."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy

from lightprobe.imaging import alpha_range, shrink_area
from lightprobe.imaging.opening import FileKind, file_kind
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo
from lightprobe.scene.pixels import load_shown

_SIDE = 256  # pixels of the longer side: finer than the texels of any predicted map
_ALL = 0.98  # share of a pixel that is white from which it tells nothing but a bound
_HAZE = 0.02  # coverage up to which a mask says that nothing is there: some are not quite black
_MARGIN = 3  # pixels around the mask that may still show the object, its shadow or what holds it


@dataclass(frozen=True)
class Background:
    """The pixels of a photo that do not show the object."""

    color: np.ndarray  # (H, W, 3) float32 linear radiance in the photo's exposure
    seen: np.ndarray  # (H, W) bool: no part of the object is in or beside the pixel
    clipped: np.ndarray  # (H, W, 3) bool: the photo's white hides how bright it is there
    camera: Camera  # of this picture, in the input frame

    @staticmethod
    def of(color: np.ndarray, white: np.ndarray, alpha: np.ndarray, camera: Camera) -> "Background":
        """Return the background of an opaque photo at 256 pixels.

        color (H, W, 3) linear, background included; white (H, W, 3) the share in [0, 1] of a pixel where the
        photo's white hides how bright it was, or bool; alpha (H, W) the object's coverage in [0, 1]. Pixels
        without any light do not count: they lie beyond what a lens showed.
        """
        small, cover = shrink_area(color, _SIDE), shrink_area(alpha, _SIDE)
        seen = ~scipy.ndimage.binary_dilation(cover > _HAZE, iterations=_MARGIN) & (small > 0).any(-1)
        clipped = shrink_area(white.astype(np.float32), _SIDE) >= _ALL
        height, width = cover.shape
        return Background(small, seen, clipped, replace(camera.resized(width, height), lens=None))


def load_background(photo: Photo) -> Background | None:
    """Return what a photo shows around the object, None for a cut-out photo; errors as `load_pixels`."""
    if photo.mask_path is None or not is_opaque(photo.image_path):
        return None
    color, alpha, white = load_shown(photo, _SIDE)
    return Background.of(color, white, alpha, photo.camera)


def is_opaque(image: Path) -> bool:
    """Return whether a photo shows what is around the object: it has no transparent pixels."""
    return file_kind(image) is FileKind.JPEG or alpha_range(image)[0] == 1

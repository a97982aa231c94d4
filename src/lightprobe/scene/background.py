"""What an opaque photo shows around the object: part of the light itself, seen directly."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from lightprobe.imaging import read_alpha
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import CLIPPED, Photo, has_white
from lightprobe.scene.pixels import load_thumbnail

_SIDE = 256  # pixels of the longer side: finer than the texels of any predicted map
_MARGIN = 3  # pixels around the mask that may still show the object, its shadow or what holds it


@dataclass(frozen=True)
class Background:
    """The pixels of a photo that do not show the object."""

    color: np.ndarray  # (H, W, 3) float32 linear radiance in the photo's exposure
    seen: np.ndarray  # (H, W) bool: no part of the object is in or beside the pixel
    clipped: np.ndarray  # (H, W, 3) bool: the photo's white hides how bright it is there
    camera: Camera  # of this picture, in the input frame


def load_background(photo: Photo) -> Background | None:
    """Return what a photo shows around the object, at 256 pixels, or None for a photo that is cut out.

    That is one whose mask is its own alpha channel, or whose pixels around the mask have one. Errors as `load_pixels`.
    """
    if photo.mask_path is None or read_alpha(photo.image_path) is not None:
        return None
    color, alpha = load_thumbnail(photo, _SIDE)
    seen = ~ndimage.binary_dilation(alpha > 0, iterations=_MARGIN)
    clipped = (color >= CLIPPED) & has_white(color)
    height, width = alpha.shape
    return Background(color, seen, clipped, photo.camera.resized(width, height))

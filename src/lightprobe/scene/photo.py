"""Photos, scenes and what flows from the loaders to the rest.

Colour: `Pixels.color` is linear, straight (not premultiplied) RGB in which 1.0 is the white of that photo.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lightprobe.imaging import CLIPPED, resize_rows
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.support import SupportPlane

OPAQUE = 0.9  # coverage from which a pixel shows the object alone
_WHITE = 1.01  # a photo with brighter values comes from a format without a white to clip at


@dataclass(frozen=True)
class Truth:
    """Ground-truth files of a synthetic photo: for evaluation only, never an input. Absent ones are None."""

    environment: Path | None = None
    linear: Path | None = None  # premultiplied linear render
    base_color: Path | None = None  # sRGB-encoded
    orm: Path | None = None  # linear; G roughness, B metallic
    normal: Path | None = None  # world-space
    light: str | None = None  # name of the environment that this and other photos' were made from


@dataclass(frozen=True)
class Photo:
    """One photo of the object with its camera in the input frame."""

    name: str  # unique in the scene and safe as a file name
    camera: Camera
    image_path: Path
    mask_path: Path | None = None  # None: the image's own alpha channel
    ev100: float | None = None  # exposure value from EXIF, if complete
    truth: Truth = field(default_factory=Truth)
    encoding: str | None = None  # colour encoding that the file declares and that is not sRGB
    light_group: str | None = None  # what photos under one light have in common; None: nothing is known
    support: SupportPlane | None = (
        None  # that the object stands on there, in the input frame; None: nothing is known
    )


def clipped(color: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Return where the object's linear straight colours (H, W, 3) reach the photo's white, (H, W, 3) bool."""
    return (color >= CLIPPED) & (alpha[..., None] > 0)


def has_white(color: np.ndarray) -> bool:
    """Return whether colours (H, W, 3) are of a photo that clips at its white: none of them is brighter."""
    return float(color.max(initial=0.0)) <= _WHITE


def reduced_size(size: tuple[int, int], opaque: float, most: int) -> tuple[int, int]:
    """Return the (height, width) at which about `most` of a photo's `opaque` `OPAQUE` pixels are left."""
    if opaque <= most:
        return size
    shrink = math.sqrt(most / opaque)
    return max(1, round(size[0] * shrink)), max(1, round(size[1] * shrink))


@dataclass(frozen=True)
class Pixels:
    """Decoded pixels of one photo."""

    color: np.ndarray  # (H, W, 3) float32, linear, straight
    alpha: np.ndarray  # (H, W) float32 in [0, 1], coverage of the object
    clipped: np.ndarray  # (H, W, 3) bool: the photo's white hides how bright the object was in the pixel

    @staticmethod
    def of(color: np.ndarray, alpha: np.ndarray) -> "Pixels":
        """Return the pixels of a photo at full size, linear straight `color` (H, W, 3) and `alpha` (H, W)."""
        return Pixels(color, alpha, clipped(color, alpha) & has_white(color))

    def within(self, most: int) -> "Pixels":
        """Return the pixels reduced until about `most` of them lie in the mask, or as they are."""
        opaque = float((self.alpha >= OPAQUE).sum())
        return self.resized(*reduced_size((self.alpha.shape[0], self.alpha.shape[1]), opaque, most))

    def resized(self, height: int, width: int) -> "Pixels":
        """Return the pixels area-averaged to `height` x `width`, colour premultiplied meanwhile.

        A pixel with any clipped source pixel is clipped: the object was at least as bright as its average.
        """
        if (height, width) == self.alpha.shape:
            return self
        planes = self.color, self.alpha, self.clipped
        whole = self.alpha.shape[0], self.alpha.shape[1]
        return averaged(lambda *rows: tuple(part[slice(*rows)] for part in planes), whole, (height, width))


def averaged(
    read: Callable[[int, int], tuple[np.ndarray, np.ndarray, np.ndarray]],
    whole: tuple[int, int],
    size: tuple[int, int],
) -> Pixels:
    """Return a photo of `whole` (height, width) area-averaged to `size`, colour premultiplied meanwhile.

    `read(first, last)` returns linear straight colour (h, W, 3), alpha (h, W) and clipped (h, W, 3) of these
    rows: the photo is never held as floats. A pixel with any clipped source pixel is clipped.
    """

    def planes(first: int, last: int) -> np.ndarray:
        color, alpha, hidden = read(first, last)
        return np.dstack([color * alpha[..., None], alpha, hidden])

    small = resize_rows(planes, (*whole, 7), *size)
    color, alpha = np.ascontiguousarray(small[..., :3]), np.ascontiguousarray(small[..., 3])
    return Pixels(color / np.maximum(alpha, 1e-6)[..., None], alpha, small[..., 4:] > 0)


@dataclass(frozen=True)
class Scene:
    """Photos split for training and testing, and the similarity to the normalised frame."""

    root: Path
    format: str  # "nerd", "transforms" or "colmap": how it was read
    train: tuple[Photo, ...]
    test: tuple[Photo, ...]
    relight: tuple[Photo, ...]  # synthetic only: novel lights with ground truth
    similarity: Similarity
    support: SupportPlane | None = (
        None  # that the object stands on in all training photos, in the input frame
    )

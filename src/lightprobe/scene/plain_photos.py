"""Photos without cameras and masks: which files they are, and what can be measured on them before cameras are
sought.

Sharpness compares detail with what is left of it after blurring, as a picture that is blurred already loses
little (Crété et al., "The blur effect", 2007); texture counts corners, which are what photos are matched by
(Shi and Tomasi, "Good features to track", 1994).
"""

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from lightprobe.imaging import (
    LUMA,
    RAW_SUFFIXES,
    PhotoFile,
    focal_ratio,
    foreign_encoding,
    gravity,
    read_exif_ev100,
    resize_rows,
    shrink_area,
    srgb_encode,
)
from lightprobe.imaging.video import difference
from lightprobe.scene.frame import Problems, list_images

SAME = 0.04  # difference of two photos' thumbnails, in standard deviations, below which they show the same
_SIDE = 1280  # pixels of the longer side that sharpness and texture are measured on, about what features are found on
_THUMBNAIL = 48  # pixels of the longer side that photos are compared on
_MASKS = frozenset({"masks", "mask"})  # folders that hold no photos
_MADE = (".prepare", "prepare.json", "config.json")  # in folders that `prepare` and `train` have made
_BLUR = 9  # pixels of the running mean that detail is compared across
_CELL = 16  # pixels of a side of the cells of which texture is the share with a corner
_CORNER = 15.0  # squared grey levels of 255 for each pixel of a cell's smaller eigenvalue; noise of 10 levels makes 4
_DARK = 0.002  # linear value below which 8 bits tell nothing
_THREADS = 2  # photos decoded at the same time at most: each takes memory


@dataclass(frozen=True)
class PlainPhoto:
    """What was measured on one photo."""

    path: Path
    width: int
    height: int
    focal: float | None  # focal length over the longer side, None: not in the file
    ev100: float | None
    up: np.ndarray | None  # (3,) direction against gravity in the camera's axes, None: not in the file
    encoding: str | None  # colour encoding that is converted
    sharpness: float  # 0 for no detail, about .3 blurred, .6 and more sharp
    texture: float  # share of the picture with corners to match
    clipped: float  # share of pixels at the photo's white
    dark: float  # share of pixels that are as good as black
    thumbnail: np.ndarray  # (h, w) uint8 grey


def list_photos(folder: Path) -> list[Path]:
    """Return the photos in a folder and its subfolders, or in its `images` folder if it has one, without
    masks.

    Of a raw file and its camera's picture of the same name only the raw file is taken, which is linear.
    Scenes and runs that were made in a subfolder hold no photos of their own.
    """
    folder = Path(folder)
    folder = folder / "images" if (folder / "images").is_dir() else folder
    images = list_images(folder)
    inner = {parent for path in images for parent in path.parents if folder in parent.parents}
    apart = {parent for parent in inner if any((parent / name).exists() for name in _MADE)}
    found = [
        path
        for path in images
        if not _MASKS & set(path.relative_to(folder).parts[:-1]) and apart.isdisjoint(path.parents)
    ]
    raw = {path.with_suffix("") for path in found if path.suffix.lower() in RAW_SUFFIXES}
    return [path for path in found if path.suffix.lower() in RAW_SUFFIXES or path.with_suffix("") not in raw]


def bright_level(luma: np.ndarray) -> float:
    """Return what stands for the white of a photo of radiance in any unit, from its linear luma (any shape).

    The 99th percentile of what is not black; 1 where all is.
    """
    lit = luma[luma > 0]
    return float(np.percentile(lit, 99)) if lit.size else 1.0


def measure_photo(path: Path) -> PlainPhoto:
    """Return what is measured on one photo; raise `InputError` naming the file when it cannot be read."""
    photo = PhotoFile(path)
    scale = min(1.0, _SIDE / max(photo.width, photo.height))
    height, width = (max(1, round(length * scale)) for length in (photo.height, photo.width))

    def planes(first: int, last: int) -> np.ndarray:
        color, _ = photo.rows(first, last)
        return np.dstack([color @ LUMA, photo.clipped_rows(first, last).any(axis=2)])

    small = resize_rows(planes, (photo.height, photo.width, 2), height, width)
    light = small[..., 0]
    bright = light if photo.has_white else light / bright_level(light)
    grey = np.clip(srgb_encode(bright), 0, 1) * 255
    return PlainPhoto(
        Path(path),
        photo.width,
        photo.height,
        focal_ratio(path),
        read_exif_ev100(path),
        gravity(path),
        foreign_encoding(path),
        sharpness(grey),
        texture(grey),
        float(small[..., 1].mean()),
        float((bright < _DARK).mean()),
        np.rint(shrink_area(grey, _THUMBNAIL)).astype(np.uint8),
    )


def measure_photos(paths: Iterable[Path], problems: Problems) -> list[PlainPhoto]:
    """Return the photos that can be read, measured, in order; what is wrong with the others goes to
    `problems`.
    """
    found = []
    with ThreadPoolExecutor(min(_THREADS, os.cpu_count() or 1)) as pool:
        for waiting in [pool.submit(measure_photo, path) for path in paths]:
            with problems.guard():
                found.append(waiting.result())
    return found


def sharpness(grey: np.ndarray) -> float:
    """Return how much of a picture's detail blurring takes away, 0 to 1, the smaller of both axes.

    grey (h, w), 0 to 255. Motion blurs along its own direction only.
    """
    lost = []
    for axis in (0, 1):
        steps = np.abs(np.diff(grey, axis=axis))
        blurred = scipy.ndimage.uniform_filter1d(grey, _BLUR, axis=axis)
        kept = np.abs(np.diff(blurred, axis=axis))
        lost.append(np.maximum(steps - kept, 0).sum() / max(float(steps.sum()), 1e-6))
    return float(min(lost))


def texture(grey: np.ndarray) -> float:
    """Return the share of cells of 16 x 16 pixels of a picture that hold a corner; grey (h, w), 0 to 255."""
    if min(grey.shape) < 2:
        return 0.0
    smooth = scipy.ndimage.gaussian_filter(grey.astype(np.float32), 1.0)
    down, across = np.gradient(smooth)
    a, b, c = (_cell_means(product) for product in (across * across, across * down, down * down))
    if not a.size:
        return 0.0
    smaller = (a + c) / 2 - np.sqrt(((a - c) / 2) ** 2 + b * b)
    return float((smaller > _CORNER).mean())


def copies(photos: Sequence[PlainPhoto]) -> list[PlainPhoto]:
    """Return the photos that show the same as one before them in the list."""
    kept: list[PlainPhoto] = []
    found: list[PlainPhoto] = []
    for photo in photos:
        alike = any(difference(photo.thumbnail, other.thumbnail) < SAME for other in kept)
        (found if alike else kept).append(photo)
    return found


def _cell_means(values: np.ndarray) -> np.ndarray:
    """Return the means (h // 16, w // 16) of `values` (h, w) over its cells."""
    height, width = (length // _CELL for length in values.shape)
    return values[: height * _CELL, : width * _CELL].reshape(height, _CELL, width, _CELL).mean(axis=(1, 3))

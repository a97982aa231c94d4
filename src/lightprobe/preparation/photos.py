"""The photos of a plain folder: which there are, what their files tell, and small pictures of them to work on."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.files import checksum
from lightprobe.imaging import (
    LUMA,
    focal_ratio,
    image_size,
    read_alpha,
    read_ldr,
    read_mask,
    resize_area,
    shrink_area,
    srgb_encode,
)
from lightprobe.scene.frame import unique_names
from lightprobe.scene.loading import has_cameras
from lightprobe.scene.masks import MaskFolder
from lightprobe.scene.plain_photos import list_photos

FEWEST = 4  # photos from which shape can be found at all
FEATURE_SIDE = 1600  # pixels of the longer side that features are found in: more costs time and brings few
COLOR_SIDE = 320  # pixels of the longer side of the pictures that objects are cut out of


@dataclass(frozen=True)
class SourcePhoto:
    """One photo as the user gave it; sizes are those of the photo turned upright."""

    name: str  # unique, and safe as a file name
    path: Path
    width: int
    height: int
    checksum: str
    focal_ratio: float | None  # focal length over the longer side, where the file tells
    mask: Path | None  # a mask file of the user's
    cutout: bool  # the photo's own alpha channel is the mask


def source_photos(folder: Path) -> list[SourcePhoto]:
    """Return the photos of `folder`, or of `images/` in it, in sorted order.

    Masks are alpha channels or files in `masks/`. Raises `InputError` for fewer than four photos or a damaged file.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder." if folder.exists() else f"{folder} does not exist.")
    paths = list_photos(folder)
    if has_cameras(folder) and paths:
        raise InputError(
            f"{folder} has cameras already; train on it with: lightprobe train {folder} -o RUN, or name the "
            "folder of its photos alone to find them anew."
        )
    if len(paths) < FEWEST:
        raise InputError(
            f"{folder} holds {len(paths)} photos; cameras cannot be found from fewer than {FEWEST}, and 30 or more "
            "from all around the object are needed for a good result."
        )
    masks = MaskFolder(folder, paths)
    names = unique_names(paths, folder)
    return [_source(path, name, masks.find(path)) for path, name in zip(paths, names, strict=True)]


def _source(path: Path, name: str, mask: Path | None) -> SourcePhoto:
    width, height = image_size(path)
    alpha = read_alpha(path) if mask is None else None
    cutout = alpha is not None and bool(alpha.min() < 0.5 <= alpha.max())
    return SourcePhoto(name, path, width, height, checksum(path), focal_ratio(path), mask, cutout)


@dataclass(frozen=True)
class WorkingPictures:
    """Small pictures of a photo."""

    grey: np.ndarray  # (H, W) uint8, at most FEATURE_SIDE, contrast evened out
    color: np.ndarray  # (h, w, 3) uint8 sRGB, at most COLOR_SIDE
    alpha: np.ndarray | None  # (h, w) float32, the mask that the user gave
    sharpness: float  # see `sharpness`


def working_pictures(photo: SourcePhoto) -> WorkingPictures:
    """Decode a photo and its mask; shapes as in `WorkingPictures`. Raises `InputError` for a damaged file."""
    linear, alpha = read_ldr(photo.path)
    given = given_mask(photo, alpha)
    color = np.clip(srgb_encode(np.clip(shrink_area(linear, COLOR_SIDE), 0, 1)) * 255 + 0.5, 0, 255).astype(np.uint8)
    grey = even_contrast(shrink_area(linear @ LUMA, FEATURE_SIDE))
    small = None if given is None else resize_area(given, *color.shape[:2])
    return WorkingPictures(grey, color, small, sharpness(grey))


def given_mask(photo: SourcePhoto, alpha: np.ndarray | None) -> np.ndarray | None:
    """Return the user's mask (H, W) float32 of a photo, None without one; `alpha` (H, W) is the photo's own.

    Raises `InputError` for a mask of another shape.
    """
    if photo.mask is None:
        return alpha if photo.cutout else None
    mask = read_mask(photo.mask)
    if abs(mask.shape[1] * photo.height - mask.shape[0] * photo.width) > 0.02 * mask.shape[0] * photo.width:
        raise InputError(
            f"{photo.mask} is {mask.shape[1]} x {mask.shape[0]}, but its photo {photo.path.name} is "
            f"{photo.width} x {photo.height}; a mask has the shape of its photo."
        )
    return resize_area(mask, photo.height, photo.width)


def even_contrast(luminance: np.ndarray) -> np.ndarray:
    """Return linear luminance (H, W) as (H, W) uint8 whose local contrast depends little on the light.

    Logarithm of the luminance over its median, black at -5 and white at +3 stops: a light twice as bright shifts it.
    """
    middle = max(float(np.median(luminance)), 1e-3)
    stops = np.log2(np.maximum(luminance, 0) / middle + 2**-5)
    return np.clip((stops + 5) / 8 * 255 + 0.5, 0, 255).astype(np.uint8)


def sharpness(grey: np.ndarray) -> float:
    """Return the deviation of a picture (H, W) uint8 from its 3 x 3 means over its deviation from its mean.

    Between copies blurred by different widths it falls with the width; noise raises it.
    """
    from scipy.ndimage import uniform_filter

    values = grey.astype(np.float32)
    return float((values - uniform_filter(values, 3)).std() / max(float(values.std()), 1e-3))


def copies(photos: Iterable[SourcePhoto]) -> dict[str, str]:
    """Return the names of photos whose file is the same as that of an earlier one, with that one's name."""
    first: dict[str, str] = {}
    found = {}
    for photo in photos:
        original = first.setdefault(photo.checksum, photo.name)
        if original != photo.name:
            found[photo.name] = original
    return found

"""The photos of a plain folder: which there are, what their files tell, and small pictures to work on."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.files import checksum, shell_word
from lightprobe.imaging import (
    LUMA,
    PhotoFile,
    alpha_range,
    focal_ratio,
    image_size,
    read_alpha,
    read_mask,
    resize_rows,
    srgb_encode,
    turned_size,
)
from lightprobe.scene.frame import unique_names
from lightprobe.scene.loading import has_cameras
from lightprobe.scene.masks import MaskFolder, mask_turn, same_shape
from lightprobe.scene.plain_photos import bright_level, list_photos
from lightprobe.scene.unread_cameras import check_folder

FEWEST = 4  # photos from which shape can be found at all
FEATURE_SIDE = 1600  # pixels of the longer side that features are found in: more costs time and brings few
COLOR_SIDE = 640  # pixels of the longer side of the pictures that objects are cut out of


@dataclass(frozen=True)
class SourcePhoto:
    """One photo as the user gave it; width and height are of the photo turned upright."""

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

    Masks are alpha channels or files in `masks/`. Raises `InputError` for fewer than four photos or a damaged
    file.
    """
    folder = Path(folder)
    check_folder(folder)
    paths = list_photos(folder)
    if has_cameras(folder) and paths:
        raise InputError(
            f"{folder} has cameras already; train on it with: lightprobe train {shell_word(folder)} -o RUN, or "
            "name the folder of its photos alone to find them anew."
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
    lowest, highest = alpha_range(path) if mask is None else (1.0, 1.0)
    cutout = lowest < 0.5 <= highest
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
    file = PhotoFile(photo.path)
    whole, small = (photo.height, photo.width), _side_within(photo, COLOR_SIDE)
    linear = resize_rows(lambda first, last: file.rows(first, last)[0], (*whole, 3), *small)
    light = resize_rows(lambda *rows: file.rows(*rows)[0] @ LUMA, whole, *_side_within(photo, FEATURE_SIDE))
    if not file.has_white:  # radiance in any unit; masks are cut by what can be told apart
        linear = linear / bright_level(linear @ LUMA)
    color = np.clip(srgb_encode(np.clip(linear, 0, 1)) * 255 + 0.5, 0, 255).astype(np.uint8)
    grey = even_contrast(light)
    return WorkingPictures(grey, color, given_mask(photo, small), sharpness(grey))


def _side_within(photo: SourcePhoto, side: int) -> tuple[int, int]:
    """Return the (height, width) of a photo whose longer side has at most `side` pixels."""
    scale = min(1.0, side / max(photo.height, photo.width))
    return max(1, round(photo.height * scale)), max(1, round(photo.width * scale))


def given_mask(photo: SourcePhoto, size: tuple[int, int]) -> np.ndarray | None:
    """Return the user's mask of a photo at `size`, (height, width) float32: its file, its alpha, or None.

    Raises `InputError` for a mask of another shape.
    """
    if photo.mask is None:
        return read_alpha(photo.path, size=size) if photo.cutout else None
    turn = mask_turn(photo.mask, photo.path, (photo.width, photo.height))
    width, height = turned_size(image_size(photo.mask, orient=False), turn)
    if not same_shape((width, height), (photo.width, photo.height)):
        raise InputError(
            f"{photo.mask} is {width} x {height}, but its photo {photo.path.name} is "
            f"{photo.width} x {photo.height}; a mask has the shape of its photo."
        )
    return read_mask(photo.mask, turn=turn, size=size)


def even_contrast(luminance: np.ndarray) -> np.ndarray:
    """Return linear luminance (H, W) as (H, W) uint8 whose local contrast depends little on the light.

    Logarithm of the luminance over its median, black at -5 and white at +3 stops: a light twice as bright
    shifts it.
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
    """Return the names of photos with the same file as an earlier photo, each with that photo's name."""
    first: dict[str, str] = {}
    found = {}
    for photo in photos:
        original = first.setdefault(photo.checksum, photo.name)
        if original != photo.name:
            found[photo.name] = original
    return found

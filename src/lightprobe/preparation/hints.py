"""What the user says about the object in one photo: a mask file or a box."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lightprobe.core.errors import ConfigError, InputError, shown
from lightprobe.imaging import read_mask, resize_area
from lightprobe.preparation.photos import SourcePhoto

_BOX = re.compile(r"\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*")


def find_photo(photos: Sequence[SourcePhoto], name: str, option: str) -> int:
    """Return the index of the photo of a file name, with or without its suffix; raise `ConfigError` for none."""
    for index, photo in enumerate(photos):
        if name in (photo.path.name, photo.path.stem, photo.name):
            return index
    example = photos[0].path.name
    raise ConfigError(f"{option}: there is no photo '{shown(name)}'; give the name of a file, such as {example}.")


def read_hint(text: str, photos: Sequence[SourcePhoto]) -> tuple[int, np.ndarray]:
    """Return the index of a photo and the mask (H, W) float32, at its full size, that PHOTO=MASK or PHOTO=BOX means.

    A box is x0,y0,x1,y1 in pixels of the photo turned upright. Raises `ConfigError` for text of another form or a box
    outside of the photo, `InputError` for a mask that cannot be read or shows nothing.
    """
    name, equals, value = text.partition("=")
    if not equals:
        raise ConfigError(f"--hint {shown(text)} says nothing; write PHOTO=MASK.png or PHOTO=x0,y0,x1,y1.")
    index = find_photo(photos, name, "--hint")
    photo = photos[index]
    box = _BOX.fullmatch(value)
    if box:
        return index, _box_mask([float(number) for number in box.groups()], photo)
    mask = read_mask(Path(value))
    if abs(mask.shape[1] * photo.height - mask.shape[0] * photo.width) > 0.02 * mask.shape[0] * photo.width:
        raise InputError(
            f"{value} is {mask.shape[1]} x {mask.shape[0]}, but {photo.path.name} is {photo.width} x {photo.height}; "
            "a mask has the shape of its photo."
        )
    if not 0 < (mask >= 0.5).mean() < 1:
        raise InputError(f"{value} shows {'nothing' if mask.max() < 0.5 else 'no background'}; paint the object white.")
    return index, resize_area(mask, photo.height, photo.width)


def _box_mask(box: list[float], photo: SourcePhoto) -> np.ndarray:
    """Return a box as mask (H, W) float32."""
    x0, y0, x1, y1 = (round(number) for number in box)
    if not (0 <= x0 < x1 <= photo.width and 0 <= y0 < y1 <= photo.height):
        raise ConfigError(
            f"--hint: the box {x0},{y0},{x1},{y1} does not lie in {photo.path.name}, which is {photo.width} x "
            f"{photo.height}; give left,top,right,bottom in its pixels."
        )
    mask = np.zeros((photo.height, photo.width), np.float32)
    mask[y0:y1, x0:x1] = 1
    return mask

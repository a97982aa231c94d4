"""The overlay sheet: every photo small, with the outline of its mask and of the visual hull's silhouette.

Where the two outlines run together, mask and camera are right; where they do not, one can see what is wrong.
"""

from pathlib import Path

import numpy as np
import scipy
from PIL import Image, ImageDraw, ImageFont

from lightprobe.core.errors import InputError
from lightprobe.core.files import atomic_path
from lightprobe.scene.frame import Split
from lightprobe.scene.inspect import Inspection, PhotoReport

MASK_COLOR, HULL_COLOR = (255, 120, 0), (0, 190, 255)  # sRGB of the two outlines
_CELL, _CAPTION, _GAP, _HEAD = 192, 18, 6, 30  # pixels
_MOST = 240  # photos on a sheet; the worst ones are shown
_PAPER, _INK = (24, 24, 24), (235, 235, 235)  # sRGB


def write_overlay_sheet(inspection: Inspection, path: Path) -> None:
    """Write the contact sheet of an inspection as PNG, worst agreement first; `InputError` when no photo is sound."""
    photos = sorted(inspection.photos, key=lambda photo: (photo.iou is not None, photo.iou or 0.0, photo.name))[:_MOST]
    if not photos:
        raise InputError(f"{inspection.root} has no sound photo to draw.")
    columns = max(4, int(np.ceil(np.sqrt(1.4 * len(photos)))))
    rows = -(-len(photos) // columns)
    pitch = (_CELL + _GAP, _CELL + _CAPTION + _GAP)
    sheet = Image.new("RGB", (columns * pitch[0] + _GAP, rows * pitch[1] + _HEAD + _GAP), _PAPER)
    draw = ImageDraw.Draw(sheet)
    small = ImageFont.load_default(11)
    _write_head(draw, inspection, len(photos))
    for index, photo in enumerate(photos):
        corner = (_GAP + index % columns * pitch[0], _HEAD + _GAP + index // columns * pitch[1])
        picture = Image.fromarray(outlined(photo))
        sheet.paste(picture, (corner[0] + (_CELL - picture.width) // 2, corner[1] + (_CELL - picture.height) // 2))
        score = "no hull" if photo.iou is None else f"{photo.iou:.3f}"
        role = "" if photo.split is Split.TRAIN else f" {photo.split.value}"
        draw.text((corner[0], corner[1] + _CELL + 2), f"{score}{role}  {photo.name}"[:30], fill=_INK, font=small)
    with atomic_path(Path(path)) as temporary:
        sheet.save(temporary, format="PNG")


def outlined(photo: PhotoReport) -> np.ndarray:
    """Return the thumbnail (h, w, 3) uint8 with the outline of the mask, and over it that of the hull."""
    picture = photo.picture.copy()
    picture[_outline(photo.mask)] = MASK_COLOR
    if photo.silhouette is not None:
        picture[_outline(photo.silhouette)] = HULL_COLOR
    return picture


def _outline(shape: np.ndarray) -> np.ndarray:
    """Return the pixels of a bool picture that touch its outside; the border of the picture is not outside."""
    return shape & ~scipy.ndimage.binary_erosion(shape, border_value=1)


def _write_head(draw: ImageDraw.ImageDraw, inspection: Inspection, shown: int) -> None:
    font = ImageFont.load_default(14)
    mean = "no visual hull" if inspection.mean_iou is None else f"mean IoU {inspection.mean_iou:.3f}"
    title = f"{inspection.root.name}: {shown} of {len(inspection.photos)} photos, worst first, {mean}     "
    position = float(_GAP)
    for text, color in ((title, _INK), ("mask   ", MASK_COLOR), ("visual hull", HULL_COLOR)):
        draw.text((position, 8), text, fill=color, font=font)
        position += draw.textlength(text, font=font)

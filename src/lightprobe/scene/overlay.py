"""The overlay sheet: every photo small, with the outline of its mask and of the visual hull's silhouette.

Where the two outlines run together, mask and camera are right; where they do not, one can see what is wrong.
"""

from pathlib import Path

import numpy as np
from PIL import ImageDraw, ImageFont

from lightprobe.core.errors import InputError
from lightprobe.core.files import atomic_path
from lightprobe.scene.contact_sheet import GAP, Cell, contact_sheet, outline
from lightprobe.scene.frame import Split
from lightprobe.scene.inspect import Inspection, PhotoReport

MASK_COLOR, HULL_COLOR = (255, 120, 0), (0, 190, 255)  # sRGB of the two outlines
_CELL, _HEAD = 192, 30  # pixels
_MOST = 240  # photos on a sheet; the worst ones are shown
_INK = (235, 235, 235)  # sRGB


def write_overlay_sheet(inspection: Inspection, path: Path) -> None:
    """Write the contact sheet of an inspection as PNG, worst agreement first; `InputError` when no photo is
    sound.
    """
    photos = sorted(
        inspection.photos, key=lambda photo: (photo.iou is not None, photo.iou or 0.0, photo.name)
    )[:_MOST]
    if not photos:
        raise InputError(f"{inspection.root} has no sound photo to draw.")
    cells = [Cell(_caption(photo), outlined(photo), _INK) for photo in photos]
    sheet = contact_sheet(cells, side=_CELL, letters=30, font=11, head=_HEAD)
    _write_head(ImageDraw.Draw(sheet), inspection, len(photos))
    with atomic_path(Path(path)) as temporary:
        sheet.save(temporary, format="PNG")


def outlined(photo: PhotoReport) -> np.ndarray:
    """Return the thumbnail (h, w, 3) uint8 with the outline of the mask, and over it that of the hull."""
    picture = photo.picture.copy()
    picture[outline(photo.mask)] = MASK_COLOR
    if photo.silhouette is not None:
        picture[outline(photo.silhouette)] = HULL_COLOR
    return picture


def _caption(photo: PhotoReport) -> str:
    score = "no hull" if photo.iou is None else f"{photo.iou:.3f}"
    role = "" if photo.split is Split.TRAIN else f" {photo.split.value}"
    return f"{score}{role}  {photo.name}"


def _write_head(draw: ImageDraw.ImageDraw, inspection: Inspection, shown: int) -> None:
    font = ImageFont.load_default(14)
    mean = "no visual hull" if inspection.mean_iou is None else f"mean IoU {inspection.mean_iou:.3f}"
    title = f"{inspection.root.name}: {shown} of {len(inspection.photos)} photos, worst first, {mean}     "
    position = float(GAP)
    for text, color in ((title, _INK), ("mask   ", MASK_COLOR), ("visual hull", HULL_COLOR)):
        draw.text((position, 8), text, fill=color, font=font)
        position += draw.textlength(text, font=font)

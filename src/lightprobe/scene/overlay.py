"""The overlay sheet of an inspection: every photo small, with the outlines of its mask and of the visual
hull.

Where the two outlines run together, mask and camera are right; where they do not, one can see what is wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from PIL import Image, ImageDraw, ImageFont

from lightprobe.core.errors import InputError
from lightprobe.core.files import atomic_path
from lightprobe.scene.frame import Split
from lightprobe.scene.inspect import Inspection, PhotoReport

GAP = 6  # pixels between cells, and around all of them
PAPER = (24, 24, 24)  # sRGB
_CAPTION_HEIGHT = 18  # pixels of a caption's height
_FEWEST_COLUMNS, _WIDTH_TO_HEIGHT = 4, 1.4  # of the sheet, in cells
MASK_COLOR, HULL_COLOR = (255, 120, 0), (0, 190, 255)  # sRGB of the two outlines
_CELL, _HEAD = 192, 30  # pixels
_MOST = 240  # photos on a sheet; the worst ones are shown
_INK = (235, 235, 235)  # sRGB


@dataclass(frozen=True)
class Cell:
    """A picture and what stands below it."""

    caption: str
    picture: np.ndarray  # (h, w, 3) uint8 sRGB, no side longer than the sheet's cells
    ink: tuple[int, int, int]  # sRGB of the caption


def contact_sheet(cells: Sequence[Cell], *, side: int, letters: int, font: int, head: int = 0) -> Image.Image:
    """Return a sheet of pictures in cells of `side` pixels.

    letters: of a caption that are shown; font: its size; head: pixels left free above.
    """
    columns = max(_FEWEST_COLUMNS, int(np.ceil(np.sqrt(_WIDTH_TO_HEIGHT * len(cells)))))
    rows = -(-len(cells) // columns)
    across, down = side + GAP, side + _CAPTION_HEIGHT + GAP
    sheet = Image.new("RGB", (columns * across + GAP, rows * down + head + GAP), PAPER)
    draw, small = ImageDraw.Draw(sheet), ImageFont.load_default(font)
    for index, cell in enumerate(cells):
        left, top = GAP + index % columns * across, head + GAP + index // columns * down
        picture = Image.fromarray(cell.picture)
        sheet.paste(picture, (left + (side - picture.width) // 2, top + (side - picture.height) // 2))
        draw.text((left, top + side + 2), cell.caption[:letters], fill=cell.ink, font=small)
    return sheet


def outline(shape: np.ndarray, width: int = 1) -> np.ndarray:
    """Return the pixels of `shape` (h, w) bool within `width` of its outside, which the border is not."""
    return shape & ~scipy.ndimage.binary_erosion(shape, iterations=width, border_value=1)


def write_overlay_sheet(inspection: Inspection, path: Path) -> None:
    """Write the sheet as PNG, worst agreement first; raise `InputError` when no photo is sound."""

    def agreement(photo: PhotoReport) -> tuple[bool, float, str]:
        return photo.iou is not None, photo.iou or 0.0, photo.name

    photos = sorted(inspection.photos, key=agreement)[:_MOST]
    if not photos:
        raise InputError(f"{inspection.root} has no sound photo to draw.")
    cells = [Cell(_caption(photo), outlined(photo), _INK) for photo in photos]
    sheet = contact_sheet(cells, side=_CELL, letters=30, font=11, head=_HEAD)
    _write_head(ImageDraw.Draw(sheet), inspection, len(photos))
    with atomic_path(Path(path)) as temporary:
        sheet.save(temporary, format="PNG")


def outlined(photo: PhotoReport) -> np.ndarray:
    """Return the thumbnail (h, w, 3) uint8 with the mask's outline, and over it the hull's."""
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

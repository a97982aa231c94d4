"""Many small pictures on one sheet, each with its caption, and outlines of masks to draw on them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from PIL import Image, ImageDraw, ImageFont

GAP = 6  # pixels between cells, and around all of them
PAPER = (24, 24, 24)  # sRGB
_CAPTION = 18  # pixels of a caption's height
_FEWEST_COLUMNS, _WIDTH_TO_HEIGHT = 4, 1.4  # of the sheet, in cells


@dataclass(frozen=True)
class Cell:
    """A picture and what stands below it."""

    caption: str
    picture: np.ndarray  # (h, w, 3) uint8 sRGB, no side longer than the sheet's cells
    ink: tuple[int, int, int]  # sRGB of the caption


def contact_sheet(cells: Sequence[Cell], *, side: int, letters: int, font: int, head: int = 0) -> Image.Image:
    """Return the sheet of pictures in cells of `side` pixels.

    letters: of a caption that are shown; font: its size; head: pixels left free above.
    """
    columns = max(_FEWEST_COLUMNS, int(np.ceil(np.sqrt(_WIDTH_TO_HEIGHT * len(cells)))))
    rows = -(-len(cells) // columns)
    across, down = side + GAP, side + _CAPTION + GAP
    sheet = Image.new("RGB", (columns * across + GAP, rows * down + head + GAP), PAPER)
    draw, small = ImageDraw.Draw(sheet), ImageFont.load_default(font)
    for index, cell in enumerate(cells):
        left, top = GAP + index % columns * across, head + GAP + index // columns * down
        picture = Image.fromarray(cell.picture)
        sheet.paste(picture, (left + (side - picture.width) // 2, top + (side - picture.height) // 2))
        draw.text((left, top + side + 2), cell.caption[:letters], fill=cell.ink, font=small)
    return sheet


def outline(shape: np.ndarray, width: int = 1) -> np.ndarray:
    """Return the pixels of `shape` (h, w) bool within `width` of its outside; the picture's border is not
    outside.
    """
    return shape & ~scipy.ndimage.binary_erosion(shape, iterations=width, border_value=1)

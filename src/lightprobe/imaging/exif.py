"""What the camera wrote beside the pixels: orientation and exposure.

EV100 = log2(N^2 / t) - log2(ISO / 100), with f-number N and exposure time t in seconds (ISO 2720).
"""

import math
import struct
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.imaging import png16
from lightprobe.imaging.opening import decode_errors, open_image

_ORIENTATION = 0x0112  # numbers of EXIF tags
_EXIF_FOLDER = 0x8769  # where the next three stand
_LEAST, _GREATEST = 1e-9, 1e9  # of seconds, f-numbers and ISO: beyond, the file is wrong
_EXPOSURE_TIME, _F_NUMBER, _ISO = 0x829A, 0x829D, 0x8827  # s, f-number, ISO


def read_exif(path: Path) -> Image.Exif:
    """Return the EXIF entries of an image file without decoding its pixels; empty when absent or broken."""
    exif = Image.Exif()
    with decode_errors(path), open_image(path) as image:
        # A PNG may carry EXIF behind its pixels, where Pillow finds it only by decoding them.
        data = png16.find_chunk(path, b"eXIf") if image.format == "PNG" else image.info.get("exif")
    try:
        if data:
            exif.load(data)
        exif.get_ifd(_EXIF_FOLDER)
    except (SyntaxError, ValueError, KeyError, TypeError, OSError, OverflowError, struct.error):
        return Image.Exif()
    return exif


def read_exif_ev100(path: Path) -> float | None:
    """Return the exposure value at ISO 100, or None when time, f-number or ISO are missing or beyond all bounds."""
    tags = read_exif(Path(path)).get_ifd(_EXIF_FOLDER)
    values = [_number(tags.get(tag)) for tag in (_EXPOSURE_TIME, _F_NUMBER, _ISO)]
    if any(value is None for value in values):
        return None
    time, f_number, iso = (float(value) for value in values if value is not None)
    return 2 * math.log2(f_number) - math.log2(time) - math.log2(iso / 100)


def read_orientation(path: Path) -> int | None:
    """Return the EXIF orientation 1..8 of an image file (1: stored upright), or None when it has no such tag."""
    value = read_exif(path).get(_ORIENTATION)
    return value if isinstance(value, int) and 1 <= value <= 8 else None


def turned_size(size: tuple[int, int], orientation: int) -> tuple[int, int]:
    """Return the (width, height) that stored pixels of `size` have when displayed with EXIF orientation 1..8."""
    return (size[1], size[0]) if orientation >= 5 else size


def undo(orientation: int) -> int:
    """Return the EXIF orientation 1..8 that turns displayed pixels back into stored ones."""
    return {6: 8, 8: 6}.get(orientation, orientation)


def upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Return stored `pixels` (H, W, ...) turned and mirrored as EXIF orientation 1..8 asks for display."""
    if orientation >= 5:  # 5..8: the stored rows are the displayed columns
        pixels = np.swapaxes(pixels, 0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return np.ascontiguousarray(pixels)


def _number(value: object) -> float | None:
    """Return a plausible EXIF number, or None; ISO may come as a tuple, rationals may divide by zero."""
    if isinstance(value, tuple):
        value = value[0] if value else None
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if _LEAST <= number <= _GREATEST else None

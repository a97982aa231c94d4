"""What every decoder tells of an image file before, and after, it decodes it."""

from dataclasses import dataclass, field

import numpy as np
from PIL import Image

from lightprobe.imaging.encodings import SRGB, Encoding


@dataclass(frozen=True)
class Header:
    """What stands beside the pixels."""

    size: tuple[int, int]  # (width, height) as stored
    exif: Image.Exif = field(default_factory=Image.Exif)  # its folders are loaded
    orientation: int | None = None  # EXIF 1..8 that the stored pixels ask for; None: the file does not say
    encoding: Encoding = SRGB


@dataclass(frozen=True)
class Samples:
    """Decoded pixels as stored, not turned."""

    values: Image.Image | np.ndarray  # 8 bits, or (H, W, 1 | 2 | 3 | 4) uint8, uint16 or float32
    encoding: Encoding  # of these values
    levels: int = 255  # the value of white of integers

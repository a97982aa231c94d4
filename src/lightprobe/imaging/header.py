"""What every decoder tells of an image file before, and after, it decodes it."""

from dataclasses import dataclass, field

import numpy as np
from PIL import Image

from lightprobe.imaging.encodings import SRGB, Encoding


@dataclass(frozen=True)
class Room:
    """What decoding takes of memory, in bytes for each pixel as stored."""

    samples: float  # that are kept
    decoding: float  # at most while they are made, themselves included
    coefficients: float | None = (
        None  # what a decoder that can reduce while it decodes takes at any size; None: cannot
    )

    def bytes(self, pixels: int, shrink: int = 1, *, turned: bool = False) -> int:
        """Return what so many pixels take, both sides divided by `shrink`; turned: whether they are copied
        upright.
        """
        reduced = max(self.decoding, 2 * self.samples if turned else 0.0) / shrink**2
        return int(pixels * (reduced + (self.coefficients or 0.0)))


@dataclass(frozen=True)
class Header:
    """What stands beside the pixels."""

    size: tuple[int, int]  # (width, height) as stored
    exif: Image.Exif = field(default_factory=Image.Exif)  # its folders are loaded
    orientation: int | None = None  # EXIF 1..8 that the stored pixels ask for; None: the file does not say
    encoding: Encoding = SRGB
    room: Room = field(default_factory=lambda: Room(0.0, 0.0))


@dataclass(frozen=True)
class Samples:
    """Decoded pixels as stored, not turned."""

    values: Image.Image | np.ndarray  # 8 bits, or (H, W, 1 | 2 | 3 | 4) uint8, uint16 or float32
    encoding: Encoding  # of these values
    levels: int = 255  # the value of white of integers
    shrink: int = 1  # what both sides of the file's picture were divided by while it was decoded, rounded up

"""EXIF entries out of bytes or a TIFF file, whatever stands there: empty when absent or broken."""

import struct
from pathlib import Path

from PIL import Image

ORIENTATION = 0x0112  # numbers of EXIF tags
EXIF_FOLDER = 0x8769  # where camera settings stand
_INTEROPERABILITY_FOLDER, _INDEX = 0xA005, 1  # where a camera names its rule of interoperability, and the tag
_ADOBE_RGB = "R03"  # that of files with Adobe RGB (DCF 2.0)
_BROKEN = (SyntaxError, ValueError, KeyError, TypeError, OSError, OverflowError, IndexError, struct.error)


def loaded_exif(source: bytes | Path | None) -> Image.Exif:
    """Return the entries of an EXIF block, with or without its `Exif` prefix, or of a TIFF file.

    Camera raw often is a TIFF inside, and EXIF is a TIFF without pixels.
    """
    exif = Image.Exif()
    try:
        if isinstance(source, Path):
            with open(source, "rb") as file:
                exif.load_from_fp(file)
                dict(exif)  # read while the file is open
                exif.get_ifd(EXIF_FOLDER)
        elif source:
            exif.load(source)
        exif.get_ifd(EXIF_FOLDER)
    except _BROKEN:
        return Image.Exif()
    return exif


def upright_exif() -> Image.Exif:
    """Return entries that say that a picture is stored as it is shown, and nothing else."""
    exif = Image.Exif()
    exif[ORIENTATION] = 1
    return exif


def orientation(exif: Image.Exif) -> int | None:
    """Return the EXIF orientation 1..8, or None when there is no such tag."""
    value = exif.get(ORIENTATION)
    return value if isinstance(value, int) and 1 <= value <= 8 else None


def is_adobe_rgb(exif: Image.Exif) -> bool:
    """Return whether a camera says by EXIF that the samples are Adobe RGB, as those do that embed no profile."""
    try:
        index = exif.get_ifd(_INTEROPERABILITY_FOLDER).get(_INDEX)
    except _BROKEN:
        return False
    return isinstance(index, str) and index.strip("\0 ") == _ADOBE_RGB

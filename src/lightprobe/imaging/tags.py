"""EXIF entries out of bytes or a TIFF file, whatever stands there: empty when absent or broken."""

import re
import struct
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.core.errors import InputError

ORIENTATION = 0x0112  # numbers of EXIF tags
EXIF_FOLDER = 0x8769  # where camera settings stand
_INTEROPERABILITY_FOLDER, _INDEX = 0xA005, 1  # where a camera names its rule of interoperability, and the tag
_ADOBE_RGB = "R03"  # that of files with Adobe RGB (DCF 2.0)
_CUSTOM_RENDERED, _APPLES_PANORAMA = 0xA401, 6  # an EXIF tag, and what Apple's cameras write there
_PROJECTION = re.compile(rb"GPano:ProjectionType[^A-Za-z]{1,8}(equirectangular|cylindrical)")  # in XMP
_MAKER_NOTE = 0x927C  # number of an EXIF tag
_APPLE, _APPLE_ENTRIES = b"Apple iOS\0\0\x01MM", 14  # start of Apple's note, and where its entries begin
_SIGNED_RATIONAL = 10  # type of an entry
_HEADROOM, _GAIN = 33, 48  # numbers of Apple's entries, of which a gain map's brightness follows
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


def check_projection(path: Path, exif: Image.Exif, xmp: bytes | str | None) -> None:
    """Raise `InputError` for a panorama by what its EXIF or XMP says: no lens' picture, whatever its shape."""
    found = _PROJECTION.search(xmp.encode() if isinstance(xmp, str) else xmp or b"")
    if found is None and exif.get_ifd(EXIF_FOLDER).get(_CUSTOM_RENDERED) != _APPLES_PANORAMA:
        return
    kind = "stitched" if found is None else found[1].decode()
    raise InputError(
        f"{path} is a panorama ({kind}), which no camera model fits; use ordinary photos, or cut views with a pinhole's "
        "perspective out of it."
    )


def apple_entry(exif: Image.Exif, number: int, count: int) -> np.ndarray | None:
    """Return (count,) float64 signed rationals of an entry of Apple's camera note, None without it.

    Numbers as in ExifTool's table of Apple tags.
    """
    note = exif.get_ifd(EXIF_FOLDER).get(_MAKER_NOTE)
    if not isinstance(note, bytes) or not note.startswith(_APPLE):
        return None
    try:
        (length,) = struct.unpack_from(">H", note, _APPLE_ENTRIES)
        entries = [struct.unpack_from(">HHII", note, _APPLE_ENTRIES + 2 + 12 * k) for k in range(length)]
        at = next(entry[3] for entry in entries if entry[:3] == (number, _SIGNED_RATIONAL, count))
        above, below = np.array(struct.unpack_from(f">{2 * count}i", note, at), np.float64).reshape(-1, 2).T
    except (struct.error, StopIteration):
        return None
    return above / below if below.all() else None


def apple_note(exif: Image.Exif) -> tuple[float, float]:
    """Return what Apple's note says of a gain map, its entries 33 and 48; raise `ValueError` without them."""
    headroom, gain = (apple_entry(exif, number, 1) for number in (_HEADROOM, _GAIN))
    if headroom is None or gain is None:
        raise ValueError("the camera's note, which says how bright it is, is missing")
    return float(headroom[0]), float(gain[0])

"""The gain map of a JPEG: a second picture behind the first, found by the multi-picture index (CIPA DC-007).

Ultra HDR says what it is by ISO 21496-1 in an APP2 segment or by XMP, Apple by an XMP type and the camera's
note in the first picture's EXIF.
"""

import io
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image, JpegImagePlugin

from lightprobe.core.reading import BoundedFile
from lightprobe.imaging.gain_map import ISO_NAME, Gain, GainMap, apple_gain, iso_gain, say_unread, xmp_gain
from lightprobe.imaging.opening import DAMAGE
from lightprobe.imaging.profiles import icc_encoding
from lightprobe.imaging.tags import apple_note, loaded_exif

_INDEX, _ENTRY = 0xB002, 16  # tag of the multi-picture index, and bytes of each of its entries
_MOST_PICTURES = 16
_XMP_MARK, _APPLE_MARK = b"http://ns.adobe.com/hdr-gain-map/1.0/", b"aux:hdrgainmap"


def read_gain_map(path: Path, image: Image.Image) -> GainMap | None:
    """Return the gain map of an open JPEG, or None where there is none that makes the picture brighter.

    A warning says why one that the file announces is left aside; the picture is read without it.
    """
    if not _announced(image):
        return None
    try:
        for content in _other_pictures(path, image):
            second = JpegImagePlugin.JpegImageFile(io.BytesIO(content))
            if _is_gain_map(second):
                gain = _gain(image, second)
                return None if gain is None else _decoded(image, second, gain)
        if any(name == "APP2" and data.startswith(ISO_NAME) for name, data in _segments(image)) or (
            _XMP_MARK in image.info.get("xmp", b"")
        ):
            raise ValueError("its second picture is missing")
    except DAMAGE as error:
        say_unread(path, str(error) or type(error).__name__)
    return None


def _announced(image: Image.Image) -> bool:
    """Return whether there may be a gain map; plain photos are not looked through."""
    return (
        "mp" in image.info
        or _XMP_MARK in image.info.get("xmp", b"")
        or any(data.startswith(ISO_NAME) for _, data in _segments(image))
    )


def _segments(image: Image.Image) -> list[tuple[str, bytes]]:
    return getattr(image, "applist", [])


def _other_pictures(path: Path, image: Image.Image) -> Iterator[bytes]:
    """Yield the bytes of the pictures behind the first, as the index has them."""
    index = Image.Exif()
    index.load(b"Exif\0\0" + image.info.get("mp", b""))
    entries = index.get(_INDEX, b"")
    with BoundedFile(path) as file:
        for k in range(1, min(len(entries) // _ENTRY, _MOST_PICTURES)):
            _, size, start = struct.unpack_from(f"{index.endian}III", entries, _ENTRY * k)
            file.seek(image.info["mpoffset"] + start)
            yield file.read(size)


def _is_gain_map(second: Image.Image) -> bool:
    xmp = second.info.get("xmp", b"")
    return _XMP_MARK in xmp or _APPLE_MARK in xmp or _iso_data(second) is not None


def _iso_data(image: Image.Image) -> bytes | None:
    found = (data for name, data in _segments(image) if name == "APP2" and data.startswith(ISO_NAME))
    return next((data.removeprefix(ISO_NAME) for data in found), None)


def _gain(image: Image.Image, second: Image.Image) -> Gain | None:
    """Return the gain by the best metadata that there are."""
    if (data := _iso_data(second)) is not None:
        return iso_gain(data)
    if _XMP_MARK in (xmp := second.info.get("xmp", b"")):
        return xmp_gain(xmp)
    return apple_gain(*apple_note(loaded_exif(image.info.get("exif"))))


def _decoded(image: Image.Image, second: Image.Image, gain: Gain) -> GainMap:
    if second.width > image.width or second.height > image.height:
        raise ValueError("it is larger than its picture")
    matrix = None
    if not gain.base_colors and (profile := second.info.get("icc_profile")):
        encoding = icc_encoding(profile)
        matrix = np.eye(3) if encoding.matrix is None else encoding.matrix
    samples = np.asarray(second if second.mode == "L" else second.convert("RGB"))
    return GainMap(samples.reshape(*samples.shape[:2], -1), gain, matrix)

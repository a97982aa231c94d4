"""HEIF files, such as phones' HEIC, with 8, 10 or 12 bits per sample, by libheif.

The format turns pictures by itself (ISO 23008-12, irot and imir), which libheif follows: stored pixels are
upright, and the EXIF orientation, which says the same once more, is left aside. Apple's gain maps are read;
those of ISO 21496-1 alone are not, as libheif's wrapper does not hand out their metadata.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.extras import photo_library
from lightprobe.imaging.color import straight
from lightprobe.imaging.encodings import Encoding, coded
from lightprobe.imaging.gain_map import GainMap, apple_gain, say_unread
from lightprobe.imaging.limits import check_pixels
from lightprobe.imaging.opening import DAMAGE, Header, Samples, decode_errors, has_tone_map
from lightprobe.imaging.profiles import icc_encoding, samples_to_srgb
from lightprobe.imaging.tags import apple_note, check_projection, loaded_exif

_COPIES = 4.0  # of the samples that libheif and its wrapper hold at once
_PREMULTIPLIED = ("RGBa", "La")  # names of modes begin so
_APPLE_GAIN_MAP = "urn:com:apple:photo:2020:aux:hdrgainmap"  # type of an auxiliary picture
_STORED_BITS = 16  # that pillow-heif moves deeper samples up to


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of the file."""
    image = _opened(path)
    samples = float(len(image.mode.split(";")[0]) * (2 if ";" in image.mode else 1))
    exif = loaded_exif(image.info.get("exif"))
    check_projection(path, exif, image.info.get("xmp"))
    return Header(image.size, exif, None, _encoding(image.info), samples * _COPIES)


def decode(path: Path) -> Samples:
    """Return the samples (H, W, 1 | 2 | 3 | 4) uint8 or uint16 of the file's primary image."""
    image = _opened(path)
    with decode_errors(path):
        values = np.asarray(image)
        values = values.reshape(*values.shape[:2], -1)
        encoding, levels = _encoding(image.info), 255
        if values.dtype == np.uint16:
            bits = min(int(image.info.get("bit_depth", _STORED_BITS)), _STORED_BITS)
            values, levels = values >> (_STORED_BITS - bits), 2**bits - 1
        if image.mode.startswith(_PREMULTIPLIED):
            values = straight(values, levels)
        return replace(samples_to_srgb(values, levels, encoding), gain_map=_gain_map(path, image))


def _gain_map(path: Path, image: Any) -> GainMap | None:
    """Return Apple's gain map of a file; a warning says why one is left aside."""
    found = (image.info.get("aux") or {}).get(_APPLE_GAIN_MAP)
    try:
        if not found:
            if has_tone_map(path):
                raise ValueError("by ISO 21496-1 in HEIF")
            return None
        gain, second = (
            apple_gain(*apple_note(loaded_exif(image.info.get("exif")))),
            image.get_aux_image(found[0]),
        )
        if second.size[0] > image.size[0] or second.size[1] > image.size[1]:
            raise ValueError("it is larger than its picture")
        samples = np.asarray(second)
    except DAMAGE as error:
        say_unread(path, str(error) or type(error).__name__)
        return None
    return GainMap(samples.reshape(*samples.shape[:2], -1)[..., :1], gain)


def _opened(path: Path) -> Any:
    """Return the file opened by pillow-heif: header read and size checked, nothing decoded."""
    library = photo_library("pillow_heif", path)
    with decode_errors(path):
        image = library.open_heif(str(path), convert_hdr_to_8bit=False)
        width, height = image.size
    check_pixels(path, width, height)
    return image


def _encoding(info: dict) -> Encoding:
    """Return the encoding by the ICC profile, or else by the code points of H.273."""
    if profile := info.get("icc_profile"):
        return icc_encoding(profile)
    points = info.get("nclx_profile") or {}
    return coded(int(points.get("color_primaries", 1)), int(points.get("transfer_characteristics", 13)))

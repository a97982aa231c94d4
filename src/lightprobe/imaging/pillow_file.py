"""PNG, JPEG, WebP and AVIF, as Pillow reads them; PNG with 16 bits per sample, which Pillow reduces, by
`png16`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, JpegImagePlugin

from lightprobe.imaging import png16
from lightprobe.imaging.avif import avif_encoding
from lightprobe.imaging.encodings import ADOBE_RGB, SRGB, Encoding
from lightprobe.imaging.header import Header, Room, Samples
from lightprobe.imaging.opening import decode_errors, open_image
from lightprobe.imaging.profiles import icc_encoding, png_encoding, samples_to_srgb, to_srgb
from lightprobe.imaging.tags import is_adobe_rgb, loaded_exif, orientation

_MODES = {"1": "L", "L": "L", "LA": "LA", "RGB": "RGB", "RGBA": "RGBA"}

# Bytes for each pixel that decoders hold beside what is kept of it
_BESIDE = {"WEBP": 8.0, "AVIF": 8.0}

_FEW_BITS = {"L;2": 3, "L;4": 15}  # how Pillow names grey of few bits -> largest value

_CODE_POINTS = 4  # bytes of a cICP chunk: primaries, transfer function, matrix and range

_SPACES = {
    b"CMYK": "CMYK",
    b"Lab ": "LAB",
}  # colour space of a profile -> Pillow's mode of it, that is not RGB or grey


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of the file."""
    with decode_errors(path), open_image(path) as image:
        # A PNG may carry EXIF behind its pixels, where Pillow finds it only by decoding them.
        data = png16.find_chunk(path, b"eXIf") if image.format == "PNG" else image.info.get("exif")
        exif = loaded_exif(data)
        return Header(image.size, exif, orientation(exif), _encoding(path, image), _room(path, image))


def _room(path: Path, image: Image.Image) -> Room:
    """Return what decoding takes: what Pillow keeps, what its decoders hold beside it, and a copy in another
    mode.
    """
    if image.format == "PNG" and png16.is_sixteen_bit(path):
        samples = 2.0 * len(image.getbands())
        return Room(samples, 3 * samples + 2)
    kept = 4.0 if len(image.getbands()) > 1 or image.mode == "P" else 1.0
    beside = _BESIDE.get(image.format or "", 0.0)
    room = Room(kept, kept + max(beside, 0.0 if image.mode in _MODES else 4.0))
    if not isinstance(image, JpegImagePlugin.JpegImageFile):
        return room
    sampling = [(horizontal, vertical) for _, horizontal, vertical, _ in image.layer]
    whole = max(pair[0] for pair in sampling) * max(pair[1] for pair in sampling)
    coefficients = (
        2.0 * sum(pair[0] * pair[1] for pair in sampling) / whole
    )  # 16 bits each, which several scans share
    return replace(room, coefficients=coefficients if "progressive" in image.info else 0.0)


def decode(path: Path, shrink: int = 1) -> Samples:
    """Return the samples of the file: 8 bits as a Pillow image, 16 as (H, W, 1 | 2 | 3 | 4) uint16.

    shrink: 2, 4 or 8 halve both sides of a JPEG so often while it is decoded, rounded up.
    """
    with open_image(path) as image, decode_errors(path):
        encoding = _encoding(path, image)
        if shrink > 1:
            image.draft(image.mode, (image.width // shrink, image.height // shrink))
            return replace(eight_bits(image, encoding), shrink=shrink)
        if image.format == "PNG" and png16.is_sixteen_bit(path):
            return samples_to_srgb(png16.decode(path), 65535, encoding)
        if image.format == "PNG":
            _spread_key(image)
        return eight_bits(image, encoding)


def eight_bits(image: Image.Image, encoding: Encoding) -> Samples:
    """Return the samples of an open image of 8 bits per sample, as grey or RGB, with alpha where it has some."""
    image = image.convert("LA") if image.mode == "La" else image
    transparent = "transparency" in image.info or image.mode in ("LA", "PA", "RGBa")
    mode = "RGBA" if transparent and image.mode != "LA" else _MODES.get(image.mode, "RGB")
    image.load()
    if encoding.profile is not None and _SPACES.get(encoding.profile[16:20]) == image.mode:
        return Samples(to_srgb(image, encoding.profile), SRGB)
    converted = image if image.mode == mode else image.convert(mode)
    if encoding.profile is None:
        return Samples(converted, encoding)
    values = np.asarray(converted)
    return samples_to_srgb(values.reshape(*values.shape[:2], -1), 255, encoding)


def _spread_key(image: Image.Image) -> None:
    """Multiply the transparent value of a grey PNG as Pillow multiplies its samples: those of 2 and 4 bits up
    to 8.
    """
    key, tiles = image.info.get("transparency"), getattr(image, "tile", ())
    largest = _FEW_BITS.get(tiles[0].args) if tiles and isinstance(tiles[0].args, str) else None
    if largest is not None and isinstance(key, int):
        image.info["transparency"] = key * (255 // largest)


def _encoding(path: Path, image: Image.Image) -> Encoding:
    points = png16.find_chunk(path, b"cICP") if image.format == "PNG" else None
    if points is not None and len(points) != _CODE_POINTS:  # a damaged chunk tells nothing
        points = None
    if points is None and (profile := image.info.get("icc_profile")):
        return icc_encoding(profile)
    if image.format == "AVIF":
        return avif_encoding(path)
    if image.format == "PNG":
        return png_encoding(image.info, points)
    return ADOBE_RGB if is_adobe_rgb(loaded_exif(image.info.get("exif"))) else SRGB

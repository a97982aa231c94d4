"""PNG, JPEG, WebP and AVIF, as Pillow reads them; PNG with 16 bits, which Pillow reduces, by `png16`."""

import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, JpegImagePlugin

from lightprobe.core.reading import BoundedFile
from lightprobe.imaging import png16
from lightprobe.imaging.encodings import ADOBE_RGB, SRGB, Encoding, coded
from lightprobe.imaging.gain_map import say_unread
from lightprobe.imaging.jpeg_gain import read_gain_map
from lightprobe.imaging.opening import Header, Samples, decode_errors, has_tone_map, open_image
from lightprobe.imaging.profiles import icc_encoding, png_encoding, samples_to_srgb, to_srgb
from lightprobe.imaging.tags import check_projection, is_adobe_rgb, loaded_exif, orientation

_MODES = {"1": "L", "L": "L", "LA": "LA", "RGB": "RGB", "RGBA": "RGBA"}
_SPACES = {b"CMYK": "CMYK", b"Lab ": "LAB"}  # colour space of a profile -> Pillow's mode, not RGB or grey
_INKS = Encoding("CMYK without a profile")  # converted as if inks were perfect: the true colours are unknown
_BESIDE = {"WEBP": 8.0, "AVIF": 8.0}  # bytes for each pixel that decoders hold beside what is kept of it
_CODE_POINTS = 4  # bytes of a cICP chunk: primaries, transfer function, matrix and range
_AVIF_HEAD = 2**20  # bytes within which an AVIF file describes its pictures: headers are a few hundred


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of the file."""
    with decode_errors(path), open_image(path) as image:
        # A PNG may carry EXIF behind its pixels, where Pillow finds it only by decoding them.
        data = png16.find_chunk(path, b"eXIf") if image.format == "PNG" else image.info.get("exif")
        exif = loaded_exif(data)
        check_projection(path, exif, image.info.get("xmp"))
        return Header(image.size, exif, orientation(exif), _encoding(path, image), _pixel_bytes(path, image))


def _pixel_bytes(path: Path, image: Image.Image) -> float:
    """Return the memory estimate: what is kept, a second copy of it or what the decoder holds beside it."""
    if image.format == "PNG" and png16.is_sixteen_bit(path):
        return 6.0 * len(image.getbands()) + 2
    kept = 4.0 if len(image.getbands()) > 1 or image.mode == "P" else 1.0
    beside = max(kept if image.mode in _MODES else 4.0, _BESIDE.get(image.format or "", 0.0))
    if isinstance(image, JpegImagePlugin.JpegImageFile) and "progressive" in image.info:
        beside = max(beside, 2.0 * len(image.getbands()))  # 16 bits of every coefficient, which scans share
    return kept + beside + (3.0 if "mp" in image.info else 0.0)  # a second picture may be a gain map


def decode(path: Path) -> Samples:
    """Return the samples of the file: 8 bits as a Pillow image, 16 as (H, W, 1 | 2 | 3 | 4) uint16."""
    with open_image(path) as image, decode_errors(path):
        encoding = _encoding(path, image)
        if image.format == "PNG" and png16.is_sixteen_bit(path):
            return samples_to_srgb(png16.decode(path), 65535, encoding)
        gain_map = read_gain_map(path, image) if isinstance(image, JpegImagePlugin.JpegImageFile) else None
        if image.format == "AVIF" and has_tone_map(path):
            say_unread(path, "in AVIF")
        return replace(_eight_bits(image, encoding), gain_map=gain_map)


def _eight_bits(image: Image.Image, encoding: Encoding) -> Samples:
    """Return the samples of an open image of 8 bits per sample, as grey or RGB, with alpha where it has some."""
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


def _encoding(path: Path, image: Image.Image) -> Encoding:
    points = png16.find_chunk(path, b"cICP") if image.format == "PNG" else None
    if points is not None and len(points) != _CODE_POINTS:  # a damaged chunk tells nothing
        points = None
    if points is None and (profile := image.info.get("icc_profile")):
        return icc_encoding(profile)
    if image.mode == "CMYK":
        return _INKS
    if image.format == "AVIF":
        return _avif_encoding(path)
    if image.format == "PNG":
        return png_encoding(image.info, points)
    return ADOBE_RGB if is_adobe_rgb(loaded_exif(image.info.get("exif"))) else SRGB


def _avif_encoding(path: Path) -> Encoding:
    """Return the encoding by the first code points of the file (ISO/IEC 23008-12, 6.5.5), sRGB without any."""
    with BoundedFile(path) as file:
        found = re.search(rb"colrnclx(.{4})", file.read(_AVIF_HEAD), re.DOTALL)
    return SRGB if found is None else coded(*struct.unpack(">HH", found[1]))

"""TIFF files: 8 bits per sample by Pillow, 16 bits and floats by OpenCV; floats are linear light.

Camera raw often is a TIFF inside; `is_raw` tells.

Both libraries turn a TIFF's pixels by its orientation, unlike those of other files, and not in all versions.
So where there is one, they are given the file with an orientation that turns nothing.
"""

import io
import logging
import struct
from pathlib import Path
from typing import Any

import numpy as np
from PIL import TiffImagePlugin

from lightprobe.core.errors import InputError
from lightprobe.core.extras import photo_library
from lightprobe.core.muted import muted
from lightprobe.core.reading import BoundedFile
from lightprobe.imaging.encodings import LINEAR, SRGB, Encoding
from lightprobe.imaging.header import Header, Room, Samples
from lightprobe.imaging.limits import check_pixels
from lightprobe.imaging.opening import decode_errors
from lightprobe.imaging.pillow_file import eight_bits
from lightprobe.imaging.premultiplied import straight
from lightprobe.imaging.profiles import icc_encoding, samples_to_srgb
from lightprobe.imaging.tags import ORIENTATION, orientation, tiff_exif

# Numbers of TIFF's tags
_PHOTOMETRIC, _PROFILE, _DNG_VERSION = 262, 34675, 50706
_MOSAIC, _LINEAR_RAW = 32803, 34892  # photometric interpretations of camera raw (DNG 1.4)
_MOST_PAGES = 8  # looked through for a mosaic; raw files hold a few previews beside it
_WHITE_IS_ZERO = 0  # photometric interpretation
_COLORS = {_WHITE_IS_ZERO: 1, 1: 1, 2: 3}  # channels of grey and RGB, by photometric interpretation
_MOST_SAMPLES = 8  # of a pixel: colour, alpha and some that are left aside
_PLANES = 2  # planar configuration: one channel after the other
_ASSOCIATED, _UNASSOCIATED = 1, 2  # extra samples that are alpha, of premultiplied and of straight colour
_SILENT = logging.NullHandler()
_CR2 = b"CR\x02\0"  # at byte 8 of Canon's raw


def is_raw(path: Path) -> bool:
    """Return whether a TIFF file is camera raw: some page of it shows a sensor's mosaic."""
    with open(path, "rb") as file:
        if file.read(12)[8:] == _CR2:
            return True
    with _opened(path) as tiff, decode_errors(path):
        pages = list(tiff.pages[:_MOST_PAGES])
        pages += [below for page in pages for below in (page.pages or ())[:_MOST_PAGES]]
        return _DNG_VERSION in pages[0].tags or any(
            _tag(page, _PHOTOMETRIC) in (_MOSAIC, _LINEAR_RAW) for page in pages
        )


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of the first page."""
    exif = tiff_exif(path)
    with _opened(path) as tiff, decode_errors(path):
        page = tiff.pages[0]
        size = (int(page.imagewidth), int(page.imagelength))
        _check_samples(path, page)
        encoding, room = _encoding(page), _room(page)
    check_pixels(path, *size)
    return Header(size, exif, orientation(exif), encoding, room)


def _room(page: Any) -> Room:
    """Return what decoding takes: of 8 bits what Pillow keeps, else the file's bytes, OpenCV's and those in
    order.

    Of a file with an orientation also its bytes, as it is read whole.
    """
    channels, bits = int(page.samplesperpixel), int(page.bitspersample)
    if bits <= 8:
        kept = 1.0 if channels == 1 else 4.0
        return Room(kept, 2 * kept + (channels if ORIENTATION in page.tags else 0.0))
    samples = channels * bits / 8
    premultiplied = _ASSOCIATED in tuple(int(extra) for extra in page.extrasamples)
    return Room(samples, 3 * samples + (16.0 * channels if premultiplied else 0.0))


def decode(path: Path) -> Samples:
    """Return the samples of the first page as stored: a Pillow image of 8 bits, or (H, W, 1..4) uint16 or
    float32.
    """
    with _opened(path) as tiff, decode_errors(path):
        page = tiff.pages[0]
        check_pixels(path, int(page.imagewidth), int(page.imagelength))
        _check_samples(path, page)
        bits, kind, encoding = (
            int(page.bitspersample),
            page.dtype.kind if page.dtype else "u",
            _encoding(page),
        )
        if bits > 8 and (kind not in "uf" or (kind == "u" and bits > 16)):
            raise InputError(
                f"{path} has samples of type {page.dtype}, which are not read; save it with 16 bits."
            )
        values = _rare(path, page) if bits > 8 and _is_rare(page, bits, kind) else None
        is_inverted = bits > 8 and kind == "u" and _tag(page, _PHOTOMETRIC) == _WHITE_IS_ZERO
        premultiplied = _ASSOCIATED in tuple(int(extra) for extra in page.extrasamples)
        turned = page.tags.get(ORIENTATION)
        unturned = None if turned is None else _with_short(path, turned.valueoffset, 1, tiff.byteorder)
    if bits <= 8:
        whole = BoundedFile(path) if unturned is None else io.BytesIO(unturned)
        with decode_errors(path), whole as file, TiffImagePlugin.TiffImageFile(file) as image:
            check_pixels(path, *image.size)
            return eight_bits(image, encoding)
    if values is None:
        data = np.fromfile(path, np.uint8) if unturned is None else np.frombuffer(unturned, np.uint8)
        values = _deep(path, data)
    if is_inverted:
        values = np.concatenate([65535 - values[..., :1], values[..., 1:]], axis=2)
    values = straight(values, 65535 if values.dtype == np.uint16 else 1.0) if premultiplied else values
    if kind == "f" or values.dtype.kind == "f":
        return Samples(values.astype(np.float32, copy=False), LINEAR)
    return samples_to_srgb(values, 65535, encoding)


def _check_samples(path: Path, page: Any) -> None:
    """Raise `InputError` when a page has far more samples than a picture; all of them would be decoded."""
    samples, depth = int(page.samplesperpixel), int(page.imagedepth)
    if samples > _MOST_SAMPLES or depth > 1:
        layers = f"{samples} samples per pixel" if depth == 1 else f"{depth} layers"
        raise InputError(
            f"{path} is a TIFF with {layers}; save a flat picture of grey or RGB, with alpha or without."
        )


def _opened(path: Path) -> Any:
    library = photo_library("tifffile", path)
    logging.getLogger("tifffile").addHandler(_SILENT)  # what matters of damage is raised
    with decode_errors(path), muted():
        try:
            return library.TiffFile(io.FileIO(path))
        except library.TiffFileError as error:
            raise ValueError(str(error)) from error


def _with_short(path: Path, offset: int, value: int, byte_order: str) -> bytearray:
    """Return the bytes of a file with a 16-bit `value` at `offset`."""
    data = bytearray(path.read_bytes())
    struct.pack_into(f"{byte_order}H", data, offset, value)
    return data


def _is_rare(page: Any, bits: int, kind: str) -> bool:
    """Return whether a page, grey or RGB, is of a kind that OpenCV decodes wrongly, or not at all."""
    channels, photometric = int(page.samplesperpixel), _tag(page, _PHOTOMETRIC)
    if photometric not in _COLORS:
        return False
    in_planes = channels > 1 and int(page.planarconfig) == _PLANES
    is_usual = channels == _COLORS[photometric] or (channels == 4 and _has_alpha(page))
    return in_planes or not is_usual or (kind == "f" and bits == 16)


def _has_alpha(page: Any) -> bool:
    return any(int(extra) in (_ASSOCIATED, _UNASSOCIATED) for extra in page.extrasamples[:1])


def _rare(path: Path, page: Any) -> np.ndarray:
    """Return (H, W, 1..4) uint16 or floats of a page in planes, of half floats, or with odd channels."""
    try:
        values = np.asarray(page.asarray())
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
        raise InputError(
            f"{path} is a TIFF of a rare kind, and compressed; save it without compression."
        ) from error
    if values.ndim == 2:
        values = values[..., None]
    elif int(page.planarconfig) == _PLANES:
        values = np.moveaxis(values, 0, 2)
    values = values[..., : _COLORS[_tag(page, _PHOTOMETRIC)] + _has_alpha(page)]
    return np.ascontiguousarray(values if values.dtype == np.uint16 else values.astype(np.float32))


def _deep(path: Path, data: np.ndarray) -> np.ndarray:
    """Return (H, W, C) uint16 or floats, as OpenCV decodes them from a file's `data` (N,) uint8."""
    library = photo_library("cv2", path)
    with decode_errors(path), muted():
        try:
            values = library.imdecode(data, library.IMREAD_UNCHANGED)
        except library.error as error:
            raise ValueError("OpenCV cannot decode it") from error
        if values is None or values.dtype.kind not in "uf" or values.dtype == np.uint8:
            raise ValueError("samples that are not read")
    values = values.reshape(*values.shape[:2], -1)
    return values[..., [2, 1, 0, 3][: values.shape[2]]] if values.shape[2] >= 3 else values


def _encoding(page: Any) -> Encoding:
    if page.dtype is not None and page.dtype.kind == "f":
        return LINEAR
    profile = _tag(page, _PROFILE)
    return icc_encoding(profile) if isinstance(profile, bytes) and profile else SRGB


def _tag(page: Any, number: int) -> Any:
    tag = page.tags.get(number)
    return None if tag is None else tag.value

"""TIFF files by tifffile: 8 and 16 bits per sample and floats, which are linear light.

Camera raw often is a TIFF inside; `is_raw` tells.
"""

import contextlib
import io
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.extras import photo_library
from lightprobe.core.muted import muted
from lightprobe.imaging.color import straight
from lightprobe.imaging.encodings import LINEAR, SRGB, Encoding, linear
from lightprobe.imaging.limits import check_pixels
from lightprobe.imaging.opening import Header, Samples, decode_errors
from lightprobe.imaging.profiles import icc_encoding, samples_to_srgb
from lightprobe.imaging.tags import loaded_exif, orientation

# Numbers of TIFF's tags
_PHOTOMETRIC, _PROFILE, _DNG_VERSION = 262, 34675, 50706
_MOSAIC, _LINEAR_RAW = 32803, 34892  # photometric interpretations of camera raw (DNG 1.4)
_MOST_PAGES = 8  # looked through for a mosaic; raw files hold a few previews beside it
_WHITE_IS_ZERO, _PALETTE, _YCBCR = 0, 3, 6  # photometric interpretations; tifffile makes the last one RGB
_JPEG = 7  # compression
_COLORS = {_WHITE_IS_ZERO: 1, 1: 1, 2: 3, _PALETTE: 1, _YCBCR: 3}  # channels without alpha
_MOST_SAMPLES = 8  # of a pixel: colour, alpha and some that are left aside
_PLANES = 2  # planar configuration: one channel after the other
_ASSOCIATED, _UNASSOCIATED = 1, 2  # extra samples that are alpha, of premultiplied and of straight colour
_DTYPES = {"bool", "uint8", "uint16", "float16", "float32", "float64"}
_CR2 = b"CR\x02\0"  # at byte 8 of Canon's raw

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # what matters of damage is raised


def is_raw(path: Path) -> bool:
    """Return whether a TIFF file is camera raw: some page of it shows a sensor's mosaic."""
    with open(path, "rb") as file:
        if file.read(12)[8:] == _CR2:
            return True
    with _opened(path) as tiff, decode_errors(path):
        return _DNG_VERSION in tiff.pages[0].tags or _sensor_page(tiff) is not None


@contextlib.contextmanager
def sensor_page(path: Path) -> Iterator[Any]:
    """Yield tifffile's page of what the sensor saw, or None of a file that has none."""
    with _opened(path) as tiff, decode_errors(path):
        yield _sensor_page(tiff)


def _sensor_page(tiff: Any) -> Any:
    pages = list(tiff.pages[:_MOST_PAGES])
    pages += [below for page in pages for below in (page.pages or ())[:_MOST_PAGES]]
    return next((page for page in pages if _tag(page, _PHOTOMETRIC) in (_MOSAIC, _LINEAR_RAW)), None)


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of the first page."""
    exif = loaded_exif(path)
    with _opened(path) as tiff, decode_errors(path):
        page = tiff.pages[0]
        _check(path, page)
        channels, stored = int(page.samplesperpixel), int(page.bitspersample) / 8
        # Memory estimate: strips as unpacked, all together, and a copy in order; division by alpha in doubles
        estimate = channels * (3 * max(stored, 1.0) + (16.0 if _ASSOCIATED in _extra(page) else 0.0))
        return Header(_size(page), exif, orientation(exif), _encoding(page), estimate)


def decode(path: Path) -> Samples:
    """Return the samples of the first page as stored, (H, W, 1 | 2 | 3 | 4) uint8, uint16 or float32."""
    with _opened(path) as tiff, decode_errors(path):
        page = tiff.pages[0]
        _check(path, page)
        photometric, encoding = int(_tag(page, _PHOTOMETRIC)), _encoding(page)
        try:
            values = np.asarray(page.asarray())
        except ValueError as error:
            if "imagecodecs" not in str(error):
                raise
            raise InputError(
                f"{path} is compressed in a way that needs the library imagecodecs; install it with: pip install "
                "imagecodecs, or save the file with ZIP compression or without any."
            ) from error
        if values.ndim == 2:
            values = values[..., None]
        elif int(page.planarconfig) == _PLANES:
            values = np.moveaxis(values, 0, 2)
        has_alpha = any(kind in (_ASSOCIATED, _UNASSOCIATED) for kind in _extra(page)[:1])
        values = values[..., : _COLORS[photometric] + has_alpha]
        if photometric == _PALETTE:
            values = (np.asarray(page.colormap)[:, values[..., 0]] >> 8).astype(np.uint8).transpose(1, 2, 0)
    if values.dtype.kind == "f":
        values = values.astype(np.float32)
        return Samples(straight(values) if _ASSOCIATED in _extra(page) else values, encoding)
    levels = 255 if photometric == _PALETTE else 2 ** int(page.bitspersample) - 1
    values = np.array(values, np.uint8 if values.dtype == bool else values.dtype)
    if photometric == _WHITE_IS_ZERO:
        values[..., 0] = levels - values[..., 0]
    values = straight(values, levels) if _ASSOCIATED in _extra(page) else values
    return samples_to_srgb(values, levels, encoding)


def _check(path: Path, page: Any) -> None:
    """Raise `InputError` when a page is too large or no flat picture of grey, RGB or a palette."""
    check_pixels(path, *_size(page))
    samples, depth = int(page.samplesperpixel), int(page.imagedepth)
    if samples > _MOST_SAMPLES or depth > 1:
        layers = f"{samples} samples per pixel" if depth == 1 else f"{depth} layers"
        raise InputError(
            f"{path} is a TIFF with {layers}; save a flat picture of grey or RGB, with alpha or without."
        )
    photometric = _tag(page, _PHOTOMETRIC)
    if photometric not in _COLORS or (photometric == _YCBCR and int(page.compression) != _JPEG):
        raise InputError(f"{path} is a TIFF of inks, Lab or YCbCr colour; save it as grey or RGB.")
    if str(page.dtype) not in _DTYPES:
        raise InputError(
            f"{path} has samples of type {page.dtype}, which are not read; save it with 16 bits."
        )


def _opened(path: Path) -> Any:
    library = photo_library("tifffile", path)
    with decode_errors(path), muted():
        try:
            return library.TiffFile(io.FileIO(path))
        except library.TiffFileError as error:
            raise ValueError(str(error)) from error


def _size(page: Any) -> tuple[int, int]:
    return int(page.imagewidth), int(page.imagelength)


def _extra(page: Any) -> tuple[int, ...]:
    return tuple(int(kind) for kind in page.extrasamples)


def _encoding(page: Any) -> Encoding:
    """Return the encoding of a page; of floats, which are linear, a profile tells the primaries."""
    profile, is_float = _tag(page, _PROFILE), page.dtype is not None and page.dtype.kind == "f"
    encoding = icc_encoding(profile) if isinstance(profile, bytes) and profile else SRGB
    if not is_float:
        return encoding
    return LINEAR if encoding.matrix is None else Encoding(encoding.name, (linear,), encoding.matrix)


def _tag(page: Any, number: int) -> Any:
    tag = page.tags.get(number)
    return None if tag is None else tag.value

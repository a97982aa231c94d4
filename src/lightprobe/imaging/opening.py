"""What kind of image a file is, told by its content, and what every decoder tells of it."""

import contextlib
import enum
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import AvifImagePlugin, Image, JpegImagePlugin, PngImagePlugin, WebPImagePlugin

from lightprobe.core.errors import InputError
from lightprobe.core.reading import LARGEST_PICTURE, BoundedFile, check_file
from lightprobe.imaging.encodings import SRGB, Encoding
from lightprobe.imaging.gain_map import GainMap
from lightprobe.imaging.limits import check_pixels

# Endings of files that folders are looked through for; what a file is, its content says.
_RAW = "3fr arw cr2 cr3 crw dng erf fff iiq mrw nef nrw orf pef raf rw2 rwl srw x3f"
_IMAGE = "png jpg jpeg jpe jfif mpo webp tif tiff heic heif hif avif exr hdr"
_VIDEO = "mp4 mov m4v avi mkv webm mts m2ts 3gp mpg mpeg"
RAW_SUFFIXES = frozenset(f".{ending}" for ending in _RAW.split())
IMAGE_SUFFIXES = RAW_SUFFIXES | frozenset(f".{ending}" for ending in _IMAGE.split())
VIDEO_SUFFIXES = frozenset(f".{ending}" for ending in _VIDEO.split())

# Decoders report damage with whatever their parsers run into.
DAMAGE = (
    *(OSError, SyntaxError, ValueError, EOFError, LookupError, TypeError, RuntimeError, OverflowError),
    *(struct.error, zlib.error),
)
_START = 64  # bytes of a file that tell its kind: a file type box of ISO 14496-12 with a few brands fits


@dataclass(frozen=True)
class Header:
    """What stands beside the pixels."""

    size: tuple[int, int]  # (width, height) as stored
    exif: Image.Exif = field(default_factory=Image.Exif)  # its folders are loaded
    orientation: int | None = None  # EXIF 1..8 that the stored pixels ask for; None: the file does not say
    encoding: Encoding = SRGB
    pixel_bytes: float = 0.0  # memory estimate: bytes for each pixel while it is decoded and turned upright


@dataclass(frozen=True)
class Samples:
    """Decoded pixels as stored, not turned."""

    values: Image.Image | np.ndarray  # 8 bits, or (H, W, 1 | 2 | 3 | 4) uint8, uint16 or float32
    encoding: Encoding  # of these values
    levels: int = 255  # the value of white of integers
    gain_map: GainMap | None = None  # what is brighter than white


class FileKind(enum.Enum):
    """Kinds of image files, by who decodes them."""

    PNG = "PNG"
    JPEG = "JPEG"
    WEBP = "WebP"
    AVIF = "AVIF"
    HEIF = "HEIF"
    TIFF = "TIFF"
    """TIFF itself, and camera raw that is a TIFF inside: `tiff.is_raw` tells them apart."""
    RAW = "camera raw"
    """Camera raw with a signature of its own."""
    EXR = "OpenEXR"
    RADIANCE = "Radiance HDR"


_MAGIC = {
    b"\x89PNG\r\n\x1a\n": FileKind.PNG,
    b"\xff\xd8\xff": FileKind.JPEG,
    b"\x76\x2f\x31\x01": FileKind.EXR,
    b"#?": FileKind.RADIANCE,
    b"II*\0": FileKind.TIFF,
    b"MM\0*": FileKind.TIFF,
    b"II+\0": FileKind.TIFF,
    b"MM\0+": FileKind.TIFF,
    b"FUJIFILMCCD-RAW": FileKind.RAW,
    b"IIRO": FileKind.RAW,
    b"IIRS": FileKind.RAW,
    b"MMOR": FileKind.RAW,
    b"IIU\0": FileKind.RAW,
    b"II\x1a\0\0\0HEAPCCDR": FileKind.RAW,
    b"FOVb": FileKind.RAW,
    b"\0MRM": FileKind.RAW,
}
# Images of other kinds, by their first bytes
_UNREAD = {
    b"BM": "a BMP image",
    b"GIF8": "a GIF image",
    b"\xff\x0a": "a JPEG XL image",
    b"\0\0\0\x0cJXL ": "a JPEG XL image",
    b"\xffO\xffQ": "a JPEG 2000 image",
    b"\0\0\0\x0cjP  ": "a JPEG 2000 image",
    b"II\xbc": "a JPEG XR image",
    b"8BPS": "a Photoshop document",
    b"%PDF": "a PDF document",
    b"qoif": "a QOI image",
}
_VIDEO_BOXES, _MATROSKA = (b"ftyp", b"moov", b"mdat", b"wide"), b"\x1aE\xdf\xa3"
_BRANDS = {
    b"avif": FileKind.AVIF,
    b"avis": FileKind.AVIF,
    b"crx ": FileKind.RAW,
    **dict.fromkeys((b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"), FileKind.HEIF),
}
STILL_BRANDS = frozenset(_BRANDS)  # file type boxes of pictures, which videos begin with too
# The readers are called directly because `Image.open` warns and raises at its own, process-wide size limit.
_READERS: dict[FileKind, Callable[..., Image.Image]] = {
    FileKind.PNG: PngImagePlugin.PngImageFile,
    FileKind.JPEG: JpegImagePlugin.JpegImageFile,
    FileKind.WEBP: WebPImagePlugin.WebPImageFile,
    FileKind.AVIF: AvifImagePlugin.AvifImageFile,
}
PILLOW_KINDS = frozenset(_READERS)


@contextlib.contextmanager
def decode_errors(path: Path) -> Iterator[None]:
    """Turn whatever a decoder raises on a damaged file into an `InputError` naming `path`."""
    try:
        yield
    except DAMAGE as error:
        detail = str(error).strip().rstrip(".") or type(error).__name__
        raise InputError(
            f"{path} cannot be decoded ({detail}); the file is damaged or cut short: copy it again."
        ) from error


def signature(path: Path) -> bytes:
    """Return the first 64 bytes of a picture; raise `InputError` when it is missing, unreadable or empty."""
    check_file(path, LARGEST_PICTURE)
    try:
        with open(path, "rb") as file:
            start = file.read(_START)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    if not start:
        raise InputError(f"{path} is empty; copy it again.")
    return start


def file_kind(path: Path) -> FileKind:
    """Return the kind of an image file; raise `InputError` when it is none that is read, or as `signature`."""
    start = signature(path)
    kind = next((kind for magic, kind in _MAGIC.items() if start.startswith(magic)), None)
    if _is_riff(start, b"WEBP"):
        kind = FileKind.WEBP
    if kind is None:
        kinds = [_BRANDS[brand] for brand in _brands(start) if brand in _BRANDS]
        kind = FileKind.AVIF if FileKind.AVIF in kinds else kinds[0] if kinds else None
    if kind is None:
        raise InputError(f"{path} {_unread(start)}")
    return kind


def _unread(start: bytes) -> str:
    """Return the end of a sentence about a file that is no image file of a kind that is read."""
    name = next((name for magic, name in _UNREAD.items() if start.startswith(magic)), None)
    if name is not None:
        return f"is {name}, which is not read; save it as PNG, or as TIFF with 16 bits."
    if start[4:8] in _VIDEO_BOXES or start.startswith(_MATROSKA) or _is_riff(start, b"AVI "):
        return "is a video where a photo is meant; give the video alone, or save a picture of it."
    return (
        "is not a PNG, JPEG or WebP image, nor TIFF, HEIC, AVIF, camera raw, OpenEXR or Radiance HDR; save it as one "
        "of these, or leave it out."
    )


def _is_riff(start: bytes, kind: bytes) -> bool:
    return start[:4] == b"RIFF" and start[8:12] == kind


def has_tone_map(path: Path) -> bool:
    """Return whether a HEIF or AVIF file announces a gain map of ISO 21496-1 (ISO/IEC 23008-12, `tmap`)."""
    return b"tmap" in _brands(signature(path))


def _brands(start: bytes) -> list[bytes]:
    """Return the brands of a file type box (ISO 14496-12): the major one, then the compatible ones."""
    if start[4:8] != b"ftyp":
        return []
    length = min(int.from_bytes(start[:4], "big"), len(start))
    return [start[8:12], *(start[i : i + 4] for i in range(16, length - 3, 4))]


@contextlib.contextmanager
def open_image(path: Path) -> Iterator[Image.Image]:
    """Yield the Pillow image of a file of `PILLOW_KINDS`: header read and size checked, nothing decoded."""
    reader = _READERS[file_kind(path)]
    # The WebP reader makes room for all pixels as soon as it is created.
    if (size := _webp_size(signature(path))) is not None:
        check_pixels(path, *size)
    with BoundedFile(path) as file:
        with decode_errors(path):
            image = reader(file)
        with image:
            check_pixels(path, *image.size)
            yield image


def _webp_size(start: bytes) -> tuple[int, int] | None:
    """Return (width, height) from the start of a WebP file (RFC 9649, section 2), None for anything else."""
    if not _is_riff(start, b"WEBP") or len(start) < 30:
        return None
    if start[12:16] == b"VP8X":
        return 1 + int.from_bytes(start[24:27], "little"), 1 + int.from_bytes(start[27:30], "little")
    if start[12:16] == b"VP8L":
        bits = int.from_bytes(start[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if start[12:16] == b"VP8 ":
        width, height = struct.unpack_from("<HH", start, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None

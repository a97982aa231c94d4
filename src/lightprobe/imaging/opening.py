"""Opening PNG, JPEG and WebP by content, with the header checked before a pixel is decoded."""

import contextlib
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

from PIL import Image, JpegImagePlugin, PngImagePlugin, WebPImagePlugin

from lightprobe.core.errors import InputError
from lightprobe.core.reading import LARGEST_PICTURE, check_file
from lightprobe.imaging.limits import check_pixels

# Pillow reports damage with whatever its parsers run into.
_DAMAGE = (OSError, SyntaxError, ValueError, EOFError, IndexError, KeyError, TypeError, struct.error, zlib.error)

# The readers are called directly because `Image.open` warns and raises at its own, process-wide size limit.
_READERS: dict[bytes, Callable[..., Image.Image]] = {
    b"\x89PNG\r\n\x1a\n": PngImagePlugin.PngImageFile,
    b"\xff\xd8\xff": JpegImagePlugin.jpeg_factory,
    b"RIFF": WebPImagePlugin.WebPImageFile,
}


@contextlib.contextmanager
def decode_errors(path: Path) -> Iterator[None]:
    """Turn whatever a decoder raises on a damaged file into an `InputError` naming `path`."""
    try:
        yield
    except _DAMAGE as error:
        detail = str(error).rstrip(".") or type(error).__name__
        raise InputError(f"{path} cannot be decoded ({detail}); the file is damaged or cut short.") from error


def signature(path: Path) -> bytes:
    """Return the first 32 bytes of a picture; raise `InputError` when it is missing, unreadable, no file or empty."""
    check_file(path, LARGEST_PICTURE)
    try:
        with open(path, "rb") as file:
            start = file.read(32)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    if not start:
        raise InputError(f"{path} is empty.")
    return start


def open_image(path: Path) -> Image.Image:
    """Return the Pillow image of a PNG, JPEG or WebP file: header read and its size checked, nothing decoded."""
    start = signature(path)
    reader = next((reader for magic, reader in _READERS.items() if start.startswith(magic)), None)
    if reader is None:
        raise InputError(f"{path} is not a PNG, JPEG or WebP image.")
    # The WebP reader makes room for all pixels as soon as it is created.
    if (size := _webp_size(start)) is not None:
        check_pixels(path, *size)
    with decode_errors(path):
        image = reader(str(path))
    with contextlib.ExitStack() as on_error:
        on_error.callback(image.close)
        check_pixels(path, *image.size)
        on_error.pop_all()
    return image


def _webp_size(start: bytes) -> tuple[int, int] | None:
    """Return (width, height) from the first 32 bytes of a WebP file (RFC 9649, section 2), None for anything else."""
    if start[:4] != b"RIFF" or len(start) < 30:
        return None
    if start[12:16] == b"VP8X":
        return 1 + int.from_bytes(start[24:27], "little"), 1 + int.from_bytes(start[27:30], "little")
    if start[12:16] == b"VP8L":
        bits = int.from_bytes(start[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if start[12:16] == b"VP8 ":
        return int.from_bytes(start[26:28], "little") & 0x3FFF, int.from_bytes(start[28:30], "little") & 0x3FFF
    return None

"""Opening PNG, JPEG and WebP by content, with the header checked before a pixel is decoded."""

import contextlib
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

from PIL import Image, JpegImagePlugin, PngImagePlugin, WebPImagePlugin

from lightprobe.core.errors import InputError
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
    """Return the first 16 bytes of a file; raise `InputError` when it is missing, unreadable or empty."""
    try:
        with open(path, "rb") as file:
            start = file.read(16)
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist.") from error
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
    with decode_errors(path):
        image = reader(str(path))
    with contextlib.ExitStack() as on_error:
        on_error.callback(image.close)
        check_pixels(path, *image.size)
        on_error.pop_all()
    return image

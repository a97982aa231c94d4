"""PNG, JPEG, WebP and AVIF, as Pillow reads them; PNG with 16 bits per sample, which Pillow reduces, by `png16`."""

from pathlib import Path

from PIL import Image

from lightprobe.imaging import png16
from lightprobe.imaging.encodings import SRGB, Encoding
from lightprobe.imaging.header import Header, Samples
from lightprobe.imaging.opening import decode_errors, open_image
from lightprobe.imaging.profiles import icc_encoding, png_encoding, to_srgb
from lightprobe.imaging.tags import loaded_exif, orientation

_MODES = {"1": "L", "L": "L", "LA": "LA", "RGB": "RGB", "RGBA": "RGBA"}


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of the file."""
    with decode_errors(path), open_image(path) as image:
        # A PNG may carry EXIF behind its pixels, where Pillow finds it only by decoding them.
        data = png16.find_chunk(path, b"eXIf") if image.format == "PNG" else image.info.get("exif")
        exif = loaded_exif(data)
        return Header(image.size, exif, orientation(exif), _encoding(path, image))


def decode(path: Path) -> Samples:
    """Return the samples of the file: 8 bits as a Pillow image, 16 as (H, W, 1 | 2 | 3 | 4) uint16."""
    with open_image(path) as image, decode_errors(path):
        encoding = _encoding(path, image)
        if image.format == "PNG" and png16.is_sixteen_bit(path):
            return Samples(png16.decode(path), encoding, 65535)
        return eight_bits(image, encoding)


def eight_bits(image: Image.Image, encoding: Encoding) -> Samples:
    """Return the samples of an open image of 8 bits per sample, as grey or RGB, with alpha where it has some."""
    transparent = "transparency" in image.info or image.mode in ("LA", "PA", "La", "RGBa")
    mode = "RGBA" if transparent and image.mode != "LA" else _MODES.get(image.mode, "RGB")
    image.load()
    if encoding.profile is not None and image.mode == encoding_mode(encoding):
        return Samples(to_srgb(image, encoding.profile), SRGB)
    return Samples(image if image.mode == mode else image.convert(mode), encoding)


def encoding_mode(encoding: Encoding) -> str | None:
    """Return Pillow's mode of the colours that a profile is for, None where Pillow has none."""
    space = (encoding.profile or b"")[16:20]
    return {b"RGB ": "RGB", b"CMYK": "CMYK", b"GRAY": "L", b"Lab ": "LAB"}.get(space)


def _encoding(path: Path, image: Image.Image) -> Encoding:
    if profile := image.info.get("icc_profile"):
        return icc_encoding(profile)
    return png_encoding(image.info, png16.find_chunk(path, b"cICP")) if image.format == "PNG" else SRGB

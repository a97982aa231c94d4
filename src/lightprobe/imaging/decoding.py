"""Headers and samples of an image file of any kind; its content, not its name, chooses the decoder."""

from pathlib import Path
from typing import Any

from lightprobe.imaging import hdr, heif, pillow_file, raw, tiff
from lightprobe.imaging.limits import check_memory
from lightprobe.imaging.opening import PILLOW_KINDS, FileKind, Header, Samples, file_kind

_DECODERS = {
    **dict.fromkeys(PILLOW_KINDS, pillow_file),
    **dict.fromkeys((FileKind.EXR, FileKind.RADIANCE), hdr),
    FileKind.HEIF: heif,
    FileKind.RAW: raw,
    FileKind.TIFF: tiff,
}


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of an image file; nothing is decoded.

    Raises `InputError` naming the file when it is missing, too large, damaged, of a kind that is not read, or
    needs a library that is not installed.
    """
    header: Header = _decoder(path).read_header(path)
    return header


def foreign_encoding(path: Path) -> str | None:
    """Return the name of the colour encoding that an image file declares, or None for sRGB or none declared.

    It is converted to sRGB while it is read, unless it is `profiles.UNREADABLE`. Read from the header; raises
    `InputError` as `read_header`.
    """
    return read_header(Path(path)).encoding.name


def decode(path: Path) -> Samples:
    """Return the samples of an image file as they are stored.

    Raises `InputError` as `read_header`, and where the memory that is free does not hold the picture.
    """
    header = read_header(path)
    check_memory(path, header.size, header.pixel_bytes)
    samples: Samples = _decoder(path).decode(path)
    return samples


def _decoder(path: Path) -> Any:
    """Return the module that reads a file."""
    kind = file_kind(path)
    return raw if kind is FileKind.TIFF and tiff.is_raw(path) else _DECODERS[kind]

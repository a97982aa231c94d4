"""Headers and samples of an image file of any kind; its content, not its name, chooses the decoder."""

from pathlib import Path

import numpy as np

from lightprobe.imaging import heif, pillow_file, raw, tiff
from lightprobe.imaging.encodings import LINEAR
from lightprobe.imaging.hdr import hdr_size, read_hdr
from lightprobe.imaging.header import Header, Samples
from lightprobe.imaging.opening import PILLOW_KINDS, FileKind, file_kind

_LEAST_ALPHA = 1e-6  # below it, premultiplied colour says nothing


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of an image file; nothing is decoded.

    Raises `InputError` naming the file when it is missing, too large, damaged, of a kind that is not read, or needs a
    library that is not installed.
    """
    kind = file_kind(path)
    if kind in PILLOW_KINDS:
        return pillow_file.read_header(path)
    if kind is FileKind.HEIF:
        return heif.read_header(path)
    if kind in (FileKind.EXR, FileKind.RADIANCE):
        return Header(hdr_size(path), encoding=LINEAR)
    return raw.read_header(path) if _is_raw(path, kind) else tiff.read_header(path)


def foreign_encoding(path: Path) -> str | None:
    """Return the name of the colour encoding that an image file declares, or None when that is sRGB or not declared.

    It is converted to sRGB while it is read, unless it is `profiles.UNREADABLE`. Read from the header; raises
    `InputError` as `read_header`.
    """
    return read_header(Path(path)).encoding.name


def decode(path: Path) -> Samples:
    """Return the samples of an image file as they are stored; raises `InputError` as `read_header`."""
    kind = file_kind(path)
    if kind in PILLOW_KINDS:
        return pillow_file.decode(path)
    if kind is FileKind.HEIF:
        return heif.decode(path)
    if kind in (FileKind.EXR, FileKind.RADIANCE):
        return Samples(_straight(read_hdr(path)), LINEAR)
    return raw.decode(path) if _is_raw(path, kind) else tiff.decode(path)


def _is_raw(path: Path, kind: FileKind) -> bool:
    return kind is FileKind.RAW or tiff.is_raw(path)


def _straight(values: np.ndarray) -> np.ndarray:
    """Return HDR values (H, W, C) with colour divided by alpha, with which OpenEXR stores it multiplied."""
    if values.shape[2] != 4:
        return values
    alpha = values[..., 3:]
    return np.concatenate([values[..., :3] / np.maximum(alpha, _LEAST_ALPHA), alpha], axis=2)

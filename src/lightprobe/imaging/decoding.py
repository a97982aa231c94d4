"""Headers and samples of an image file of any kind; its content, not its name, chooses the decoder."""

import threading
from pathlib import Path

from lightprobe.core.memory_limit import memory_left
from lightprobe.imaging import heif, pillow_file, raw, tiff
from lightprobe.imaging.encodings import LINEAR
from lightprobe.imaging.hdr import hdr_size, read_hdr, stored_bytes
from lightprobe.imaging.header import Header, Room, Samples
from lightprobe.imaging.limits import say_reduced, too_large
from lightprobe.imaging.opening import PILLOW_KINDS, FileKind, file_kind
from lightprobe.imaging.premultiplied import straight

_DECIDING = threading.Lock()  # one thread after the other: what is left is told only once a photo is decoded
_HDR_SAMPLES = 16.0  # bytes of a pixel that are kept: four floats


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of an image file; nothing is decoded.

    Raises `InputError` naming the file when it is missing, too large, damaged, of a kind that is not read, or
    needs a library that is not installed.
    """
    kind = file_kind(path)
    if kind in PILLOW_KINDS:
        return pillow_file.read_header(path)
    if kind is FileKind.HEIF:
        return heif.read_header(path)
    if kind in (FileKind.EXR, FileKind.RADIANCE):
        room = Room(_HDR_SAMPLES, _HDR_SAMPLES + stored_bytes(path))
        return Header(hdr_size(path), encoding=LINEAR, room=room)
    return raw.read_header(path) if _is_raw(path, kind) else tiff.read_header(path)


def foreign_encoding(path: Path) -> str | None:
    """Return the name of the colour encoding that an image file declares, or None when that is sRGB or not
    declared.

    It is converted to sRGB while it is read, unless it is `profiles.UNREADABLE`. Read from the header; raises
    `InputError` as `read_header`.
    """
    return read_header(Path(path)).encoding.name


def decode(path: Path) -> Samples:
    """Return the samples of an image file as they are stored, or reduced where the limit of memory asks for
    it.

    Raises `InputError` as `read_header`, and where the limit leaves no room for it.
    """
    if memory_left() is None:
        return _decoded(path, 1)
    with _DECIDING:
        return _decoded(path, affordable_shrink(path))


def _decoded(path: Path, shrink: int) -> Samples:
    kind = file_kind(path)
    if kind in PILLOW_KINDS:
        return pillow_file.decode(path, shrink)
    if kind is FileKind.HEIF:
        return heif.decode(path)
    if kind in (FileKind.EXR, FileKind.RADIANCE):
        return Samples(straight(read_hdr(path)), LINEAR)
    return raw.decode(path) if _is_raw(path, kind) else tiff.decode(path)


def _is_raw(path: Path, kind: FileKind) -> bool:
    return kind is FileKind.RAW or tiff.is_raw(path)


def affordable_shrink(path: Path) -> int:
    """Return what both sides of a photo are divided by while it is decoded: 1, or what the limit of memory
    asks for.

    Raises `InputError` where it is too large however it is decoded; a warning says when it is reduced.
    """
    left = memory_left()
    if left is None:
        return 1
    header = read_header(path)
    (width, height), room, turned = header.size, header.room, (header.orientation or 1) != 1
    needed = room.bytes(width * height, turned=turned)
    if needed <= left:
        return 1
    shrinks = () if room.coefficients is None else (2, 4, 8)
    for shrink in shrinks:
        if room.bytes(width * height, shrink, turned=turned) <= left:
            say_reduced(path, (width, height), (-(-width // shrink), -(-height // shrink)), needed)
            return shrink
    raise too_large(path, (width, height), needed)

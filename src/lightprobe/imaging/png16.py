"""PNG with 16 bits per sample, which Pillow reduces to 8 (ISO/IEC 15948: chunks, filters, Adam7 interlacing)."""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from lightprobe.core.jit import compiled
from lightprobe.core.reading import BoundedFile

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}  # colour type -> samples per pixel
_COLOR_TYPE = {channels: kind for kind, channels in _CHANNELS.items()}
# (first column, first row, column step, row step) of the seven interlacing passes
_ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))


def is_sixteen_bit(path: Path) -> bool:
    """Tell whether the PNG at `path` has 16 bits per sample."""
    with open(path, "rb") as file:
        return file.read(25)[24:25] == b"\x10"


def find_chunk(path: Path, kind: bytes) -> bytes | None:
    """Return the data of the first chunk of `kind` in a PNG, skipping over the others, or None."""
    with BoundedFile(path) as file:
        return next((file.read(length) for name, length in _chunks(file) if name == kind), None)


def decode(path: Path) -> np.ndarray:
    """Return the samples of a 16-bit PNG, (H, W, C) uint16, C = 1 grey, 2 grey + alpha, 3 RGB or 4 RGBA.

    The caller has checked the size in the header. Raises `ValueError` or `zlib.error` on a damaged file.
    """
    header, data, transparent = b"", bytearray(), None
    with BoundedFile(path) as file:
        for kind, length in _chunks(file):
            if kind in (b"IHDR", b"IDAT", b"tRNS"):
                content = _checked(file, kind, length)
                if kind == b"IHDR":
                    header = content
                elif kind == b"IDAT":
                    data += content
                else:
                    transparent = np.frombuffer(content, ">u2")
    width, height, _, color_type, _, _, interlaced = struct.unpack(">IIBBBBB", header)
    if color_type not in _CHANNELS:
        raise ValueError(f"colour type {color_type} does not exist with 16 bits")
    channels = _CHANNELS[color_type]
    pixels = np.zeros((height, width, channels), np.uint16)
    passes = [pixels[y::dy, x::dx] for x, y, dx, dy in _ADAM7] if interlaced else [pixels]
    passes = [part for part in passes if part.size]
    raw = _inflate(data, sum(part.shape[0] * (1 + part.shape[1] * channels * 2) for part in passes))
    del data
    for part in passes:
        raw = _fill(part, raw)
    if transparent is not None and len(transparent) == channels:
        opaque = (pixels != transparent).any(axis=2, keepdims=True)
        pixels = np.concatenate([pixels, opaque * np.uint16(65535)], axis=2)
    return pixels


def encode(samples: np.ndarray) -> bytes:
    """Return a 16-bit PNG file of `samples` (H, W, 1 | 2 | 3 | 4) uint16."""
    height, width, channels = samples.shape
    rows = np.ascontiguousarray(samples.astype(">u2")).view(np.uint8).reshape(height, -1)
    filtered = np.full((height, rows.shape[1] + 1), 2, np.uint8)  # filter 2: difference to the row above
    filtered[0, 1:] = rows[0]
    filtered[1:, 1:] = rows[1:] - rows[:-1]
    header = struct.pack(">IIBBBBB", width, height, 16, _COLOR_TYPE[channels], 0, 0, 0)
    data = _chunk(b"IDAT", zlib.compress(filtered.tobytes()))
    return _SIGNATURE + _chunk(b"IHDR", header) + data + _chunk(b"IEND", b"")


def _chunks(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Yield (kind, length) with `file` at the start of that chunk's data, up to IEND or the end of the file."""
    position = len(_SIGNATURE)
    while True:
        file.seek(position)
        head = file.read(8)
        if len(head) < 8 or head[4:] == b"IEND":
            return
        length = int.from_bytes(head[:4], "big")
        yield head[4:], length
        position += 12 + length


def _checked(file: BinaryIO, kind: bytes, length: int) -> bytes:
    """Return the data of the chunk `file` stands at; raise `ValueError` when cut short or of a wrong checksum."""
    content, crc = file.read(length), file.read(4)
    if len(content) != length or crc != struct.pack(">I", zlib.crc32(kind + content)):
        raise ValueError(f"bad {kind.decode()} chunk")
    return content


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def _inflate(data: bytes | bytearray, size: int) -> np.ndarray:
    """Decompress to exactly `size` bytes; never more, whatever the stream claims."""
    raw = zlib.decompressobj().decompress(data, size)
    if len(raw) != size:
        raise ValueError(f"{len(raw)} of {size} bytes of pixels")
    return np.frombuffer(raw, np.uint8)


def _fill(part: np.ndarray, raw: np.ndarray) -> np.ndarray:
    """Undo the filters of one pass at the start of `raw` into `part` (h, w, C); return the rest of `raw`."""
    height, width, channels = part.shape
    stride = width * channels * 2
    rows = raw[: height * (stride + 1)].reshape(height, stride + 1)
    if rows[:, 0].max() > 4:
        raise ValueError("unknown row filter")
    part[...] = _unfilter(rows, channels * 2).view(">u2").reshape(part.shape)
    return raw[rows.size :]


@compiled()
def _unfilter(rows: np.ndarray, step: int) -> np.ndarray:
    """Undo the filters of `rows` (h, 1 + stride), which start with their type; `step`: bytes per pixel."""
    height, stride = rows.shape[0], rows.shape[1] - 1
    out = np.zeros((height, stride), np.uint8)
    for y in range(height):
        kind = rows[y, 0]
        for x in range(stride):
            left = int(out[y, x - step]) if x >= step else 0
            up = int(out[y - 1, x]) if y > 0 else 0
            predicted = 0
            if kind == 1:
                predicted = left
            elif kind == 2:
                predicted = up
            elif kind == 3:
                predicted = (left + up) // 2
            elif kind == 4:
                corner = int(out[y - 1, x - step]) if y > 0 and x >= step else 0
                predicted = _paeth(left, up, corner)
            out[y, x] = (int(rows[y, x + 1]) + predicted) & 255
    return out


@compiled()
def _paeth(left: int, up: int, corner: int) -> int:
    """Return the neighbour closest to left + up - corner; ties prefer left, then up."""
    estimate = left + up - corner
    to_left, to_up, to_corner = abs(estimate - left), abs(estimate - up), abs(estimate - corner)
    if to_left <= to_up and to_left <= to_corner:
        return left
    return up if to_up <= to_corner else corner

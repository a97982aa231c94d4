"""What a DNG file asks for and LibRaw leaves undone (DNG 1.7): lens shading, and kinds that it misreads.

Telephones' lenses darken corners to a half or a third. Their DNG files hold the sensor's plain values, and in
OpcodeList2 the gains that make a white wall even: opcodes `GainMap`, for a mosaic one for each of its four
colours. Gains are bilinear between the map's points, whose places are fractions of the active area.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.imaging import tiff
from lightprobe.imaging.resize import bilinear_grid

_OPCODES_2, _GAIN_MAP = 51009, 9  # tag of the list, and number of the opcode
_HEAD = struct.Struct(">10I4dI")  # of a gain map's parameters
_MOST_OPCODES, _MOST_POINTS, _GREATEST_GAIN = 64, 2**20, 64.0
_JPEG_XL = (50002, 52546)  # compressions


@dataclass(frozen=True)
class Shading:
    """One gain map."""

    area: tuple[slice, slice]  # rows and columns of the active area that it is for
    origin: tuple[float, float]  # of its first point, in fractions of the active area: down, across
    spacing: tuple[float, float]
    gains: np.ndarray  # (h, w) float32

    def gain(self, size: tuple[int, int]) -> np.ndarray:
        """Return the gain of the pixels of its area, float32, in an active area of `size` (height, width)."""
        places = []
        for axis in (0, 1):
            pixels = np.arange(size[axis])[self.area[axis]]
            step = self.spacing[axis] or 1.0  # of a map with a single point
            places.append(((pixels + 0.5) / size[axis] - self.origin[axis]) / step)
        return bilinear_grid(self.gains[..., None], *places)[..., 0]


def check_dng(path: Path) -> None:
    """Raise `InputError` for a DNG file of a kind that LibRaw refuses or misreads."""
    with tiff.sensor_page(path) as page:
        if page is None:
            return
        compression, is_float = int(page.compression), page.dtype is not None and page.dtype.kind == "f"
        samples = int(page.samplesperpixel)
    if compression in _JPEG_XL:
        raise InputError(
            f"{path} is a DNG compressed as JPEG XL, which is not read; set the camera to lossless JPEG, or convert the "
            "file with Adobe DNG Converter, compatible with version 1.6 or earlier."
        )
    if is_float and samples > 1:
        raise InputError(
            f"{path} is a DNG of floats that are colours already, as merged exposures are, which is not read; save it as "
            "OpenEXR or as TIFF of floats."
        )


def shadings(path: Path) -> list[Shading]:
    """Return the gain maps of a DNG file's mosaic; raise `ValueError` or `struct.error` where it is damaged."""
    with tiff.sensor_page(path) as page:
        tag = None if page is None else page.tags.get(_OPCODES_2)
        content = None if tag is None else tag.value
    if not isinstance(content, bytes):
        return []
    return [_shading(data) for number, data in _opcodes(content) if number == _GAIN_MAP]


def even_out(raw: Any, found: list[Shading]) -> None:
    """Multiply an open raw file's mosaic by gain maps, in place."""
    mosaic, colors = raw.raw_image_visible, raw.raw_colors_visible
    blacks = np.array(raw.black_level_per_channel, np.float32)
    for shading in found:
        black = blacks[colors[shading.area]]
        light = (mosaic[shading.area] - black) * shading.gain(mosaic.shape)
        mosaic[shading.area] = np.clip(np.rint(light + black), 0, np.iinfo(mosaic.dtype).max)


def _opcodes(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield number and parameters of each opcode of a list."""
    (count,), at = struct.unpack_from(">I", data), 4
    if count > _MOST_OPCODES:
        raise ValueError(f"{count} opcodes")
    for _ in range(count):
        number, _, _, size = struct.unpack_from(">4I", data, at)
        yield number, data[at + 16 : at + 16 + size]
        at += 16 + size


def _shading(data: bytes) -> Shading:
    top, left, bottom, right, _, _, down, across, rows, columns, *places, planes = _HEAD.unpack_from(data)
    if not (down and across and 0 < rows * columns * planes <= _MOST_POINTS):
        raise ValueError("a gain map without an area or points")
    gains = np.frombuffer(data, ">f4", rows * columns * planes, _HEAD.size).reshape(rows, columns, planes)
    if not (np.isfinite(places).all() and ((gains >= 0) & (gains <= _GREATEST_GAIN)).all()):
        raise ValueError("a gain map with numbers that no lens has")
    area = slice(top, bottom, down), slice(left, right, across)
    return Shading(area, (places[2], places[3]), (places[0], places[1]), gains[..., 0].astype(np.float32))

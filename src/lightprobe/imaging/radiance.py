"""Radiance HDR (.hdr): shared-exponent pixels, read with or without run-length coding, written without.

A pixel is four bytes (r, g, b, e) meaning (r, g, b) * 2^(e - 136), and 0 when e = 0. Rows of 8..32767 pixels
are stored as four planes of runs; narrower and wider ones, and old files, pixel by pixel (Ward, "Real
Pixels", Graphics Gems II). Of the header EXPOSURE, COLORCORR and PRIMARIES are applied, and the order of the scan
lines; VIEW and PIXASPECT, which say how a picture was rendered and is shown, are not needed.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.files import write_bytes
from lightprobe.core.jit import compiled
from lightprobe.imaging.encodings import SRGB_XY, matrix_to_srgb
from lightprobe.imaging.limits import check_pixels

_BIAS = 136  # 128 of the exponent, 8 of the mantissa's bits
_LARGEST = 255 * 2.0 ** (255 - _BIAS)
_AT_ONCE = 2**18  # pixels that are made bytes, or floats, at once
_ARTICLES = {"EXPOSURE": "an", "COLORCORR": "a", "PRIMARIES": "a line of", "GAMMA": "a"}
_HEADER_LIMIT = 1 << 16  # bytes; real headers have hundreds


@dataclass(frozen=True)
class _RadianceHeader:
    """What stands before the pixels."""

    order: tuple[
        str, str
    ]  # of the scan lines and of the pixels in one: -Y for downwards, +X to the right, ...
    lines: int
    length: int  # pixels of a line
    gain: np.ndarray  # (3,) float64 by which the stored values are too high: EXPOSURE times COLORCORR
    to_srgb: np.ndarray | None  # (3, 3) of PRIMARIES, None where these are sRGB's or not given
    start: int  # of the pixels, bytes

    @property
    def size(self) -> tuple[int, int]:
        """Return the (width, height) of the picture upright."""
        return (self.lines, self.length) if self.order[0][1] == "X" else (self.length, self.lines)

    def upright(self, stored: np.ndarray) -> np.ndarray:
        """Return pixels (lines, length, C) as rows from the top, (H, W, C), a view."""
        stored = stored[:: -1 if self.order[0] in ("+Y", "-X") else 1]
        stored = stored[:, :: -1 if self.order[1] in ("+Y", "-X") else 1]
        return stored.swapaxes(0, 1) if self.order[0][1] == "X" else stored


def read_radiance(path: Path) -> np.ndarray:
    """Read a Radiance file: (H, W, 3) float32 linear RGB, as before its EXPOSURE and COLORCORR, in sRGB's primaries.

    Raises `InputError` for a damaged file, and for XYZ and GAMMA.
    """
    data = np.fromfile(path, np.uint8)
    header = _parse_header(path, data[:_HEADER_LIMIT].tobytes())
    check_pixels(path, *header.size)
    pixels = np.zeros((header.lines, header.length, 4), np.uint8)
    if not _decode(data, header.start, pixels):
        raise InputError(
            f"{path} cannot be decoded as Radiance HDR; the file is damaged or cut short: copy it again."
        )
    del data
    upright = header.upright(pixels)
    color = np.empty((*upright.shape[:2], 3), np.float32)
    step = max(1, _AT_ONCE // upright.shape[1])
    for top in range(
        0, upright.shape[0], step
    ):  # in strips: the doubles would take five times what comes out
        rows = upright[top : top + step]
        exponent = rows[..., 3].astype(np.int32)
        scale = np.where(exponent > 0, np.ldexp(1.0, exponent - _BIAS), 0.0)[..., None] / header.gain
        values = rows[..., :3] * scale
        color[top : top + step] = (
            values if header.to_srgb is None else np.maximum(values @ header.to_srgb.T, 0)
        )
    return color


def radiance_size(path: Path) -> tuple[int, int]:
    """Return (width, height) from the header of a Radiance file; `InputError` when damaged."""
    with open(path, "rb") as file:
        start = file.read(_HEADER_LIMIT)
    size = _parse_header(path, start).size
    check_pixels(path, *size)
    return size


def write_radiance(path: Path, array: np.ndarray) -> None:
    """Write linear RGB `array` (H, W, 3) as Radiance HDR, pixel by pixel without runs, atomically.

    A value is off by at most 1/256 (0.4 %) of its pixel's largest channel, half a step of its eight bits;
    negative values and NaN become 0.
    """
    height, width = array.shape[:2]
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode()
    step = max(1, _AT_ONCE // max(width, 1))
    strips = (_shared_exponents(array[top : top + step]) for top in range(0, height, step))
    write_bytes(Path(path), b"".join([header, *(strip.tobytes() for strip in strips)]))


def _shared_exponents(rows: np.ndarray) -> np.ndarray:
    """Return linear RGB `rows` (h, W, 3) as bytes (h, W, 4)."""
    color = np.clip(np.nan_to_num(np.asarray(rows, np.float64)), 0, _LARGEST)
    exponent = np.frexp(color.max(axis=2))[1]
    # A largest channel that rounds up to 256 needs the next exponent.
    exponent += np.rint(np.ldexp(color.max(axis=2), 8 - exponent)) > 255
    mantissa = np.rint(np.ldexp(color, (8 - exponent)[..., None]))
    stored = np.where(color.max(axis=2) > 0, exponent + _BIAS - 8, 0)
    pixels = np.concatenate([mantissa, stored[..., None]], axis=2)
    pixels[(stored < 1) | (stored > 255)] = 0
    return pixels.astype(np.uint8)


def _parse_header(path: Path, text: bytes) -> _RadianceHeader:
    found = re.search(rb"\n\r?\n([+-])([XY]) +(\d{1,9}) +([+-])([XY]) +(\d{1,9})\r?\n", text)
    if found is None or found[2] == found[5]:
        raise InputError(
            f"{path} is not a Radiance HDR: its header names no size, such as -Y height +X width."
        )
    lines = (
        text[: found.start()].decode("latin-1").split("\n")
    )  # one that begins with a tab is of an older file
    settings = [line.split("=", 1) for line in lines if "=" in line and not line.startswith(("#", "\t", " "))]
    if any(key == "FORMAT" and value.strip() == "32-bit_rle_xyze" for key, value in settings):
        raise InputError(f"{path} is a Radiance HDR in XYZ colour; convert it to RGB.")
    gain, to_srgb = np.ones(3), None
    for key, value in settings:
        if key in ("EXPOSURE", "COLORCORR"):
            gain = gain * _numbers(path, key, value, 1 if key == "EXPOSURE" else 3, is_positive=True)
        elif key == "PRIMARIES":
            named = _numbers(path, key, value, 8)
            to_srgb = matrix_to_srgb(named)
            if to_srgb is None and not np.allclose(named, np.ravel(SRGB_XY), atol=0.01):
                raise InputError(f"{path} has a line of PRIMARIES that are no colours; remove it.")
        elif key == "GAMMA" and _numbers(path, key, value, 1, is_positive=True)[0] != 1:
            raise InputError(f"{path} has a GAMMA of {value.strip()[:20]}; save it with linear values.")
    order = (found[1] + found[2]).decode(), (found[4] + found[5]).decode()
    return _RadianceHeader(order, int(found[3]), int(found[6]), gain, to_srgb, found.end())


def _numbers(path: Path, key: str, value: str, count: int, *, is_positive: bool = False) -> np.ndarray:
    """Return the numbers (count,) of a line of the header."""
    try:
        numbers = [float(word) for word in value.split()]
    except ValueError:
        numbers = []
    fits = len(numbers) == count and all(map(math.isfinite, numbers))
    if not fits or (is_positive and min(numbers) <= 0):
        words = {1: "that is not a positive number", 3: "that is not three positive numbers"}
        raise InputError(
            f"{path} has {_ARTICLES[key]} {key} {words.get(count, 'that is not eight numbers')}."
        )
    return np.array(numbers)


@compiled()
def _decode(data: np.ndarray, position: int, pixels: np.ndarray) -> bool:
    """Decode `data` from `position` into `pixels` (H, W, 4); return False for data damaged or too short."""
    height, width = pixels.shape[:2]
    for y in range(height):
        is_long = 8 <= width < 32768 and position + 4 <= data.size
        planes = is_long and data[position] == 2 and data[position + 1] == 2
        if planes and (data[position + 2] << 8) + data[position + 3] == width:
            position = _decode_planes(data, position + 4, pixels[y])
        else:
            position = _decode_pixels(data, position, pixels[y])
        if position < 0:
            return False
    return True


@compiled()
def _decode_planes(data: np.ndarray, position: int, row: np.ndarray) -> int:
    """Decode one row stored as four run-length coded planes; return the next position or -1."""
    width = row.shape[0]
    for channel in range(4):
        x = 0
        while x < width:
            if position + 1 >= data.size:
                return -1
            count = int(data[position])
            run = count > 128
            count = count - 128 if run else count
            if count == 0 or x + count > width or (not run and position + count >= data.size):
                return -1
            for k in range(count):
                row[x + k, channel] = data[position + 1] if run else data[position + 1 + k]
            x += count
            position += 2 if run else 1 + count
    return position


@compiled()
def _decode_pixels(data: np.ndarray, position: int, row: np.ndarray) -> int:
    """Decode a row stored pixel by pixel, (1, 1, 1, n) repeating the last one; return the next position or -1."""
    x, shift = 0, 0
    while x < row.shape[0]:
        if position + 4 > data.size:
            return -1
        if data[position] == 1 and data[position + 1] == 1 and data[position + 2] == 1:
            count = int(data[position + 3]) << shift
            if x == 0 or x + count > row.shape[0]:
                return -1
            for k in range(count):
                row[x + k] = row[x - 1]
            x += count
            shift = min(shift + 8, 24)
        else:
            row[x] = data[position : position + 4]
            x += 1
            shift = 0
        position += 4
    return position

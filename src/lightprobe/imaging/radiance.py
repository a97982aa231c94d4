"""Radiance HDR (.hdr): shared-exponent pixels, read with or without run-length coding, written without.

A pixel is four bytes (r, g, b, e) meaning (r, g, b) * 2^(e - 136), and 0 when e = 0. Rows of 8..32767 pixels
are stored as four planes of runs; narrower and wider ones, and old files, pixel by pixel (Ward, "Real
Pixels", Graphics Gems II).
"""

import re
from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.files import write_bytes
from lightprobe.core.jit import compiled
from lightprobe.imaging.limits import check_pixels

_BIAS = 136  # 128 of the exponent, 8 of the mantissa's bits
_LARGEST = 255 * 2.0 ** (255 - _BIAS)
_AT_ONCE = 2**18  # pixels that are made bytes, or floats, at once
_HEADER_LIMIT = 1 << 16  # bytes; real headers have hundreds


def read_radiance(path: Path) -> np.ndarray:
    """Read a Radiance file: (H, W, 3) float32 linear RGB, over the file's EXPOSURE; `InputError` when damaged."""
    data = np.fromfile(path, np.uint8)
    width, height, exposure, start = _parse_header(path, data[:_HEADER_LIMIT].tobytes())
    check_pixels(path, width, height)
    pixels = np.zeros((height, width, 4), np.uint8)
    if not _decode(data, start, pixels):
        raise InputError(f"{path} cannot be decoded as Radiance HDR; the file is damaged or cut short.")
    del data
    color = np.empty((height, width, 3), np.float32)
    step = max(1, _AT_ONCE // width)
    for top in range(0, height, step):  # in strips: the doubles would take five times what comes out
        rows = pixels[top : top + step]
        exponent = rows[..., 3].astype(np.int32)
        scale = np.where(exponent > 0, np.ldexp(1.0, exponent - _BIAS), 0.0) / exposure
        color[top : top + step] = rows[..., :3] * scale[..., None]
    return color


def radiance_size(path: Path) -> tuple[int, int]:
    """Return (width, height) from the header of a Radiance file; `InputError` when damaged."""
    with open(path, "rb") as file:
        start = file.read(_HEADER_LIMIT)
    width, height, _, _ = _parse_header(path, start)
    check_pixels(path, width, height)
    return width, height


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


def _parse_header(path: Path, text: bytes) -> tuple[int, int, float, int]:
    """Return (width, height, exposure, offset of the pixels)."""
    found = re.search(rb"\n\n-Y (\d{1,9}) \+X (\d{1,9})\n", text)
    if found is None:
        raise InputError(
            f"{path} is not a Radiance HDR stored row by row from top left (-Y height +X width)."
        )
    lines = [line.strip() for line in text[: found.start()].split(b"\n")]
    if b"FORMAT=32-bit_rle_xyze" in lines:
        raise InputError(f"{path} is a Radiance HDR in XYZ colour; convert it to RGB.")
    exposure = 1.0
    try:
        for line in lines:
            if line.startswith(b"EXPOSURE="):
                exposure *= float(line[9:])
    except ValueError:
        exposure = 0.0
    if not 0 < exposure < np.inf:
        raise InputError(f"{path} has an EXPOSURE that is not a positive number.")
    return int(found[2]), int(found[1]), exposure, found.end()


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

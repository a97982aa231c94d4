"""How large an image may be: what a header may announce, and what the machine's memory leaves room for."""

import math
import warnings
from pathlib import Path

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.core.memory import available_bytes

MAX_PIXELS = 134_217_728  # 2^27, a 16384 x 8192 environment: 1.6 GB as float32 RGB

WORKED_PIXELS = 2**24  # of a new photo that are held as floats: larger ones are area-averaged while read
_WORKED_BYTES = 96  # for each of these, at most, that locating and predicting take
_BESIDE = 128 * 2**20  # bytes: the strips of rows that are worked on beside a photo
_LATER = 300 * 10**6  # bytes that locating and predicting take by themselves, once the photo is read
_FEWEST_WORKED = 2**18  # pixels: smaller pictures show too little of an object

_warned: set[tuple[Path, tuple[int, int]]] = set()


def check_pixels(path: Path, width: int, height: int) -> None:
    """Raise `InputError` when the header of `path` announces an empty or an absurdly large image."""
    if min(width, height) < 1:
        raise InputError(f"{path} has no pixels ({width} x {height}).")
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{path} announces {width} x {height} pixels, more than the {MAX_PIXELS / 1e6:.0f} million this program "
            "decodes; scale the image down."
        )


def memory_left() -> int | None:
    """Return the bytes that the machine has free for a photo, None where it does not tell."""
    free = available_bytes()
    return None if free is None else max(free - _BESIDE, 0)


def check_memory(path: Path, size: tuple[int, int], pixel_bytes: float) -> None:
    """Raise `InputError` where the memory that is free does not hold a photo at its full size.

    size: (width, height); pixel_bytes: memory estimate of the work, bytes for each pixel.
    """
    left, needed = memory_left(), size[0] * size[1] * pixel_bytes
    if left is not None and needed > left:
        raise InputError(
            f"{path} has {size[0]} x {size[1]} pixels: {_estimate(needed, left)}; scale it down or close other "
            "programs."
        )


def worked_size(path: Path, size: tuple[int, int], wanted: tuple[int, int] | None = None) -> tuple[int, int]:
    """Return the (height, width) that a new photo is worked on at: `wanted`, by default its `size`, or less.

    Less is `WORKED_PIXELS`, or what fits into the memory that is free; a warning says the latter, once for
    each photo. Raises `InputError` where too little fits.
    """
    height, width = wanted or size
    left = memory_left()
    most = WORKED_PIXELS if left is None else min(WORKED_PIXELS, max(left - _LATER, 0) // _WORKED_BYTES)
    if height * width <= most:
        return height, width
    if most < min(_FEWEST_WORKED, WORKED_PIXELS):
        check_memory(path, (size[1], size[0]), _WORKED_BYTES + _LATER / (size[0] * size[1]))
    shrink = math.sqrt(most / (height * width))
    reduced = max(1, math.floor(height * shrink)), max(1, math.floor(width * shrink))
    if left is not None and most < WORKED_PIXELS and (path, reduced) not in _warned:
        _warned.add((path, reduced))
        needed = min(height * width, WORKED_PIXELS) * _WORKED_BYTES + _LATER
        warnings.warn(
            f"{path} is reduced from {size[1]} x {size[0]} to {reduced[1]} x {reduced[0]} pixels: "
            f"{_estimate(needed, left)}.",
            LightprobeWarning,
            stacklevel=2,
        )
    return reduced


def _estimate(needed: float, left: int) -> str:
    return f"this would take {needed / 1e9:.2f} GB of memory, more than the {left / 1e9:.2f} GB that are free"

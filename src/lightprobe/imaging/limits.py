"""The size an image header may announce before anything is decoded, and the size that photos are worked on
at.
"""

import math
import warnings
from pathlib import Path

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.core.memory_limit import current_limit, in_gigabytes, memory_left

MAX_PIXELS = 134_217_728  # 2^27, a 16384 x 8192 environment: 1.6 GB as float32 RGB

WORKED_PIXELS = (
    2**24
)  # of a new photo that are held as floats at once: larger ones are area-averaged while read
_WORKED_BYTES = 96  # for each of these, at most, that locating and predicting take
_LATER = 300 * 10**6  # bytes that locating and predicting take by themselves, once the photo is read
_FEWEST_WORKED = 2**18  # pixels: smaller pictures show too little of an object

_said: set[tuple[Path, tuple[int, int]]] = set()


def check_pixels(path: Path, width: int, height: int) -> None:
    """Raise `InputError` when the header of `path` announces an empty or an absurdly large image."""
    if min(width, height) < 1:
        raise InputError(f"{path} has no pixels ({width} x {height}).")
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{path} announces {width} x {height} pixels, more than the {MAX_PIXELS / 1e6:.0f} million this program "
            "decodes; scale the image down."
        )


def worked_size(path: Path, size: tuple[int, int], wanted: tuple[int, int] | None = None) -> tuple[int, int]:
    """Return the (height, width) that a new photo of `size` is worked on at: `wanted`, by default `size`, or
    less.

    Less is `WORKED_PIXELS`, or what the limit of memory leaves room for; a warning says the latter. Raises
    `InputError` where it leaves too little.
    """
    height, width = wanted or size
    left = None if (free := memory_left()) is None else max(free - _LATER, 0)
    most = WORKED_PIXELS if left is None else min(WORKED_PIXELS, left // _WORKED_BYTES)
    if height * width <= most:
        return height, width
    needed = min(height * width, WORKED_PIXELS) * _WORKED_BYTES + _LATER
    if most < min(_FEWEST_WORKED, WORKED_PIXELS):
        raise too_large(path, (size[1], size[0]), needed)
    shrink = math.sqrt(most / (height * width))
    reduced = max(1, math.floor(height * shrink)), max(1, math.floor(width * shrink))
    if most < WORKED_PIXELS:
        say_reduced(path, (size[1], size[0]), (reduced[1], reduced[0]), needed)
    return reduced


def check_room(path: Path, size: tuple[int, int], pixel_bytes: float) -> None:
    """Raise `InputError` where the limit of memory leaves no room to work on all of a photo's pixels at once.

    size: (width, height); pixel_bytes: what the work takes for each pixel.
    """
    left, needed = memory_left(), size[0] * size[1] * pixel_bytes
    if left is not None and needed > left:
        raise too_large(path, size, needed)


def say_reduced(path: Path, size: tuple[int, int], reduced: tuple[int, int], needed: float) -> None:
    """Warn, once for each photo, that one of `size` (width, height) is reduced, as it would take `needed`
    bytes.
    """
    if (path, reduced) in _said:
        return
    _said.add((path, reduced))
    warnings.warn(
        f"{path} is reduced from {size[0]} x {size[1]} to {reduced[0]} x {reduced[1]} pixels: {_expectation(needed)}.",
        LightprobeWarning,
        stacklevel=3,
    )


def too_large(path: Path, size: tuple[int, int], needed: float) -> InputError:
    """Return the error of a photo of `size` (width, height) that would take `needed` bytes."""
    return InputError(
        f"{path} has {size[0]} x {size[1]} pixels: {_expectation(needed)}; scale it down, save it as a baseline "
        "JPEG, which can be reduced while it is read, or raise the limit."
    )


def _expectation(needed: float) -> str:
    left, limit = memory_left(), current_limit()
    if left is None or limit is None:
        raise ValueError("There is no limit.")
    expected = limit - left + needed
    return f"{in_gigabytes(expected)} of memory are expected, more than --max-memory {in_gigabytes(limit)}"

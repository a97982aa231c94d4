"""What the camera wrote beside the pixels: orientation, exposure, focal length and the direction of gravity.

EV100 = log2(N^2 / t) - log2(ISO / 100), with f-number N and exposure time t in seconds (ISO 2720).

Focal length: an equivalent of 35 mm film stands for the same angle over the *diagonal*, 43.27 mm of 36 x 24
mm film (CIPA DCG-001), whatever the shape of the sensor; over the longer side this is f / 36 for 3:2 and f /
34.6 for 4:3. COLMAP's f / 35 lies between the two.
"""

import math
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.imaging.decoding import read_header
from lightprobe.imaging.tags import EXIF_FOLDER, ORIENTATION, apple_entry

_LEAST, _GREATEST = 1e-9, 1e9  # of seconds, f-numbers and ISO: beyond, the file is wrong
# Numbers of EXIF tags: s, f-number, ISO
_EXPOSURE_TIME, _F_NUMBER, _ISO = 0x829A, 0x829D, 0x8827
# mm, mm of 35 mm film
_FOCAL_LENGTH, _FOCAL_LENGTH_35 = 0x920A, 0xA405
# Pixels along the sensor's width for each unit of length, that unit, and the size in pixels that this is
# meant for
_PLANE_RESOLUTION, _PLANE_UNIT, _PIXELS_X, _PIXELS_Y = 0xA20E, 0xA210, 0xA002, 0xA003
_UNITS = {2: 25.4, 3: 10.0, 4: 1.0}  # mm of an inch, a centimetre and a millimetre
_FILM_DIAGONAL = math.hypot(36, 24)  # mm
_PLAUSIBLE_FOCAL = 0.2, 30.0  # of the longer side: fisheye lenses and telescopes lie beyond
# Programs that scale a photo down write its new size, but keep the pitch: the size is the sensor's only where
# it is a camera's, in pixels, and makes one of the usual widths of sensors, in mm.
_LEAST_PIXELS = 2000
_SENSORS, _SENSOR_STEP = (53.4, 43.8, 36.0, 23.5, 22.3, 17.3, 13.2, 8.8, 7.5, 6.17), 0.03  # relative
_AGREE = 0.1  # relative difference of two statements of one focal length, the second rounded to mm
_LENS_MODEL = 0xA434  # number of an EXIF tag
_ACCELERATION = 8  # number of an entry of Apple's note
_AT_REST = 0.7, 1.3  # length in g of an acceleration that is gravity


def read_exif_ev100(path: Path) -> float | None:
    """Return the exposure value at ISO 100, or None when time, f-number or ISO are missing or absurd."""
    tags = read_header(path).exif.get_ifd(EXIF_FOLDER)
    values = [_number(tags.get(tag)) for tag in (_EXPOSURE_TIME, _F_NUMBER, _ISO)]
    if any(value is None for value in values):
        return None
    time, f_number, iso = (float(value) for value in values if value is not None)
    return 2 * math.log2(f_number) - math.log2(time) - math.log2(iso / 100)


def read_orientation(path: Path) -> int | None:
    """Return the EXIF orientation 1..8 of an image file (1: stored upright), or None when it has no such tag.

    HEIC has none here: it is turned by the format itself while it is decoded.
    """
    return read_header(Path(path)).orientation


def focal_ratio(path: Path) -> float | None:
    """Return the focal length over the longer side of the whole picture, or None when the file does not tell.

    From the sensor's pitch and the focal length in mm, where these are a camera's own, or from the equivalent
    of 35 mm film, by the diagonal (above); the latter alone where the two disagree. Neither knows of later
    cropping.
    """
    header = read_header(Path(path))
    tags = header.exif.get_ifd(EXIF_FOLDER)
    measured, rounded = _by_pitch(tags), _by_film(tags, header.size)
    if measured is not None and rounded is not None and abs(measured / rounded - 1) > _AGREE:
        return rounded
    return measured if measured is not None else rounded


def gravity(path: Path) -> np.ndarray | None:
    """Return the direction up, against gravity, (3,) float64 of length 1, or None when the file does not tell.

    In OpenGL's camera axes (x right, y up, looking along -z) of the picture turned upright. From the
    acceleration that Apple's cameras note (entry 8 in ExifTool's table of Apple tags): as seen from the
    screen, x points to the left, y to the bottom and z into the device, and at rest the value points up. A
    picture that is not turned has the device's right side on top; cameras on the side of the screen are
    mirrored and are left out.
    """
    exif = read_header(Path(path)).exif
    tags = exif.get_ifd(EXIF_FOLDER)
    value = _acceleration(exif)
    if value is None or "front" in str(tags.get(_LENS_MODEL, "")).lower():
        return None
    x, y, z = -value / np.linalg.norm(value)  # device: right, top, towards the user
    turned = {1: (-y, x), 3: (y, -x), 6: (x, y), 8: (-x, -y)}
    tag = exif.get(ORIENTATION, 1)
    return np.array([*turned[tag], z]) if tag in turned else None


def turned_size(size: tuple[int, int], orientation: int) -> tuple[int, int]:
    """Return the (width, height) that stored pixels of `size` have when displayed with EXIF orientation 1..8."""
    return (size[1], size[0]) if orientation >= 5 else size


def undo(orientation: int) -> int:
    """Return the EXIF orientation 1..8 that turns displayed pixels back into stored ones."""
    return {6: 8, 8: 6}.get(orientation, orientation)


def upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Return stored `pixels` (H, W, ...) turned and mirrored as EXIF orientation 1..8 asks for display."""
    if orientation >= 5:  # 5..8: the stored rows are the displayed columns
        pixels = np.swapaxes(pixels, 0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return np.ascontiguousarray(pixels)


def _by_pitch(tags: dict) -> float | None:
    keys = (_FOCAL_LENGTH, _PLANE_RESOLUTION, _PIXELS_X, _PIXELS_Y)
    focal, resolution, width, height = (_number(tags.get(key)) for key in keys)
    unit = _UNITS.get(tags.get(_PLANE_UNIT, 2))
    if focal is None or resolution is None or width is None or height is None or unit is None:
        return None
    sensor = max(width, height) / resolution * unit
    usual = any(abs(sensor / known - 1) <= _SENSOR_STEP for known in _SENSORS)
    return _plausible(focal / sensor) if usual and max(width, height) >= _LEAST_PIXELS else None


def _by_film(tags: dict, size: tuple[int, int]) -> float | None:
    focal = _number(tags.get(_FOCAL_LENGTH_35))
    return None if focal is None else _plausible(focal / _FILM_DIAGONAL * math.hypot(*size) / max(size))


def _plausible(ratio: float) -> float | None:
    return ratio if _PLAUSIBLE_FOCAL[0] <= ratio <= _PLAUSIBLE_FOCAL[1] else None


def _acceleration(exif: Image.Exif) -> np.ndarray | None:
    """Return the acceleration (3,) in g out of Apple's note, or None: no such note, or moving."""
    value = apple_entry(exif, _ACCELERATION, 3)
    return value if value is not None and _AT_REST[0] <= np.linalg.norm(value) <= _AT_REST[1] else None


def _number(value: object) -> float | None:
    """Return a plausible EXIF number, or None; ISO may come as a tuple, rationals may divide by zero."""
    if isinstance(value, tuple):
        value = value[0] if value else None
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if _LEAST <= number <= _GREATEST else None

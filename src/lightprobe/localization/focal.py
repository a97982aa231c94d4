"""The focal length that a camera wrote into its photo.

An equivalent focal length f35 is that of a 35 mm film camera with the same angle over the diagonal, which is 43.27 mm
long in film (CIPA DC-008, FocalLengthIn35mmFilm).
"""

import math
from pathlib import Path

from lightprobe.imaging import image_size
from lightprobe.imaging.exif import read_exif

_EXIF_FOLDER, _FOCAL_35 = 0x8769, 0xA405  # numbers of EXIF tags
_DIAGONAL = math.hypot(36, 24)  # mm, of film
_PLAUSIBLE = 5, 2000  # mm; 0 means unknown


def focal_ratio(path: Path) -> float | None:
    """Return the focal length of a photo over its longer side, both in pixels, or None when its file does not tell.

    Raises `InputError` when the file cannot be read.
    """
    value = read_exif(Path(path)).get_ifd(_EXIF_FOLDER).get(_FOCAL_35)
    if not isinstance(value, int | float) or not _PLAUSIBLE[0] <= value <= _PLAUSIBLE[1]:
        return None
    width, height = image_size(Path(path))
    return float(value) / _DIAGONAL * math.hypot(width, height) / max(width, height)

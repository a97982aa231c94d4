"""A camera raw file of a made-up camera: the least that Adobe's DNG specification asks for, written by
tifffile.
"""

import struct

import numpy as np
import tifffile

_PLACEHOLDER = 65000  # tag in whose place the EXIF folder is put, which tifffile does not write
BLACK, WHITE = 64, 4095  # levels of the sensor
XYZ_TO_CAMERA = np.array([[0.9, -0.3, -0.05], [-0.4, 1.2, 0.2], [-0.05, 0.2, 0.6]])
NEUTRAL = (0.5, 1.0, 0.7)  # camera values of white


def write_dng(path, camera, *, orientation=1, focal_35=None):
    """Write camera values (H, W, 3), 1.0 where the sensor saturates, as a mosaic of red, green, green, blue."""
    height, width = camera.shape[:2]
    color = np.array([[0, 1], [1, 2]])[np.arange(height)[:, None] % 2, np.arange(width)[None] % 2]
    mosaic = np.take_along_axis(camera, color[..., None], axis=2)[..., 0]
    mosaic = np.clip(np.rint(BLACK + mosaic * (WHITE - BLACK)), 0, WHITE).astype(np.uint16)

    def rational(values):
        return [part for value in np.ravel(values) for part in (round(value * 10000), 10000)]

    tags = [
        (274, "H", 1, orientation, True),
        (50706, "B", 4, (1, 4, 0, 0), True),
        (50708, "s", 0, "Test Camera", True),
        (33421, "H", 2, (2, 2), True),
        (33422, "B", 4, (0, 1, 1, 2), True),
        (50714, "H", 1, BLACK, True),
        (50717, "H", 1, WHITE, True),
        (50721, "2i", 9, rational(XYZ_TO_CAMERA), True),
        (50728, "2I", 3, rational(NEUTRAL), True),
        (50778, "H", 1, 21, True),
    ]
    if focal_35 is not None:
        tags.append((_PLACEHOLDER, "I", 1, 0, True))
    tifffile.imwrite(path, mosaic, photometric=32803, extratags=tags, metadata=None)
    if focal_35 is not None:
        _append_exif(path, focal_35)
    return path


def _append_exif(path, focal_35):
    """Append an EXIF folder of one entry, the focal length on 35 mm film, and lead to it."""
    content = path.read_bytes()
    entry = struct.pack("<HHI", _PLACEHOLDER, 4, 1)
    at = content.index(entry)
    place = struct.pack("<HHII", 0x8769, 4, 1, len(content))
    folder = struct.pack("<HHHIII", 1, 0xA405, 3, 1, focal_35, 0)
    path.write_bytes(content[:at] + place + content[at + len(place) :] + folder)

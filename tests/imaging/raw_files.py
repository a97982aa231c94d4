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


def write_dng(path, camera, *, orientation=1, focal_35=None, extra=(), **options):
    """Write camera values (H, W, 3), 1.0 where the sensor saturates, as a mosaic of red, green, green, blue.

    extra: more of tifffile's extratags; options: tifffile's others.
    """
    height, width = camera.shape[:2]
    color = np.array([[0, 1], [1, 2]])[np.arange(height)[:, None] % 2, np.arange(width)[None] % 2]
    mosaic = np.take_along_axis(camera, color[..., None], axis=2)[..., 0]
    mosaic = np.clip(np.rint(BLACK + mosaic * (WHITE - BLACK)), 0, WHITE).astype(np.uint16)

    tags = [
        *_camera_tags(orientation),
        (33421, "H", 2, (2, 2), True),
        (33422, "B", 4, (0, 1, 1, 2), True),
        (50714, "H", 1, BLACK, True),
        (50717, "H", 1, WHITE, True),
        *extra,
    ]
    if focal_35 is not None:
        tags.append((_PLACEHOLDER, "I", 1, 0, True))
    tifffile.imwrite(path, mosaic, photometric=32803, extratags=tags, metadata=None, **options)
    if focal_35 is not None:
        _append_exif(path, focal_35)
    return path


def write_linear_dng(
    path, camera, *, blacks=(0, 0, 0), white=65535, orientation=1, dtype=np.uint16, **options
):
    """Write camera values (H, W, 3), 1.0 where the sensor saturates, as colours that are no mosaic any more.

    blacks: of each channel, or of all of them, (1,); options: tifffile's, as `compression`.
    """
    levels = np.array(blacks) + camera * (white - np.array(blacks))
    levels = levels if np.dtype(dtype).kind == "f" else np.clip(np.rint(levels), 0, white)
    tags = [
        *_camera_tags(orientation),
        (50714, "H", len(blacks), blacks if len(blacks) > 1 else blacks[0], True),
        (50717, "H", 1, white, True),
    ]
    told = {"photometric": 34892, "planarconfig": "contig", "extratags": tags, "metadata": None, **options}
    tifffile.imwrite(path, levels.astype(dtype), **told)
    return path


def lens_shading(gains, *, size, cell=(0, 0), step=2):
    """A gain map of DNG's list of opcodes: gains (h, w) from edge to edge of a mosaic of `size` (height, width).

    cell: the pixel of a mosaic of `step` x `step` that it is for.
    """
    rows, columns = gains.shape
    spacing = [1 / max(points - 1, 1) for points in (rows, columns)]
    head = struct.pack(">10I4dI", *cell, *size, 0, 1, step, step, rows, columns, *spacing, 0.0, 0.0, 1)
    content = head + gains.astype(">f4").tobytes()
    return struct.pack(">4I", 9, 0x01030000, 0, len(content)) + content


def opcode_list(*opcodes):
    """The tag of OpcodeList2."""
    content = struct.pack(">I", len(opcodes)) + b"".join(opcodes)
    return (51009, "B", len(content), content, True)


def _rational(values):
    return [part for value in np.ravel(values) for part in (round(value * 10000), 10000)]


def _camera_tags(orientation):
    return [
        (274, "H", 1, orientation, True),
        (50706, "B", 4, (1, 4, 0, 0), True),
        (50708, "s", 0, "Test Camera", True),
        (50721, "2i", 9, _rational(XYZ_TO_CAMERA), True),
        (50728, "2I", 3, _rational(NEUTRAL), True),
        (50778, "H", 1, 21, True),
    ]


def _append_exif(path, focal_35):
    """Append an EXIF folder of one entry, the focal length on 35 mm film, and lead to it."""
    content = path.read_bytes()
    entry = struct.pack("<HHI", _PLACEHOLDER, 4, 1)
    at = content.index(entry)
    place = struct.pack("<HHII", 0x8769, 4, 1, len(content))
    folder = struct.pack("<HHHIII", 1, 0xA405, 3, 1, focal_35, 0)
    path.write_bytes(content[:at] + place + content[at + len(place) :] + folder)

"""Environment maps as the page takes them: half floats, ready for the graphics card.

A map goes out as rows from the bottom up, (H, 2H) texels of four half floats R, G, B, 1, linear radiance in
the convention of our files (z up), which three.js' y-up scene needs no turn for.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.light.environment import read_map
from lightprobe.light.upsampling import reduced_map

_ROWS = 512  # of the largest map that is sent; a scene cannot show more
_MOST = 60_000.0  # radiance; half floats end at 65504


@dataclass(frozen=True)
class LightTexels:
    """A map for the page."""

    data: bytes
    height: int
    scale: float  # that the values were divided by


def light_suffix(path: Path, name: str) -> str:
    """Return the suffix of a map by what its file holds; raise `InputError` calling it `name` for another
    file.
    """
    with open(path, "rb") as file:
        start = file.read(4)
    if len(start) == 4 and struct.unpack("<I", start)[0] == 20000630:  # OpenEXR's magic number
        return ".exr"
    if start.startswith(b"#?"):
        return ".hdr"
    raise InputError(
        f"{name} is no OpenEXR and no Radiance HDR file; choose an .exr or .hdr environment map."
    )


def light_texels(path: Path) -> LightTexels:
    """Return a map, reduced to at most 512 rows; raise `InputError` as `read_map`."""
    image = read_map(path)
    if image.shape[0] > _ROWS:
        image = reduced_map(image, _ROWS)
    scale = max(float(image.max(initial=0.0)) / _MOST, 1.0)
    height = image.shape[0]
    texels = np.ones((height, 2 * height, 4), np.float16)
    texels[..., :3] = image[::-1] / scale
    return LightTexels(texels.tobytes(), height, scale)

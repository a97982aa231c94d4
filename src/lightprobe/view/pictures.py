"""Photos and environment maps as the page takes them.

A photo is decoded by our own reader, upright, in sRGB, small. A map goes out as half floats, ready for the graphics
card: rows from the bottom up, (H, 2H) texels R, G, B, 1, linear radiance in the convention of our files (z up), which
three.js' y-up scene needs no turn for.
"""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.imaging import shrink_area, srgb_encode
from lightprobe.light.environment import read_map
from lightprobe.light.upsampling import reduced_map
from lightprobe.scene import new_photo
from lightprobe.scene.pixels import load_thumbnail
from lightprobe.view.sources import RunPhoto, RunSource

SIDE = 1024  # pixels of the longer side of a photo
_OPAQUE = 0.99  # alpha from which a photo counts as not cut out
_ROWS = 512  # of the largest map that is sent; a scene cannot show more
_MOST = 60_000.0  # radiance; half floats end at 65504


def run_photo(source: RunSource, photo: RunPhoto) -> bytes:
    """Return a photo of a run as PNG or JPEG, through a pinhole as its camera says; cut-out ones keep their
    alpha.

    Raises `InputError` when its file is gone or damaged.
    """
    image, mask = source.files(photo)
    color, alpha = load_thumbnail(new_photo(image, source.run.scene_file, mask), SIDE)
    if float(alpha.min()) >= _OPAQUE:
        return jpeg(color)
    cover = np.rint(255 * np.clip(alpha, 0, 1)).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(np.dstack([_bytes(color), cover])).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def jpeg(color: np.ndarray) -> bytes:
    """Return a picture of linear colour (H, W, 3), reduced to the page's size, as JPEG."""
    buffer = io.BytesIO()
    Image.fromarray(_bytes(shrink_area(color, SIDE))).save(buffer, "JPEG", quality=90)
    return buffer.getvalue()


def _bytes(color: np.ndarray) -> np.ndarray:
    return np.rint(255 * srgb_encode(np.clip(color, 0, 1))).astype(np.uint8)


@dataclass(frozen=True)
class LightTexels:
    """A map for the page."""

    data: bytes
    height: int
    scale: float  # that the values were divided by


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

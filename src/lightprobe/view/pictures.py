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

from lightprobe.imaging import read_ldr, shrink_area, srgb_encode
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
    image = source.image_file(photo)
    color, alpha = load_thumbnail(new_photo(image, source.run.scene_file, source.mask_file(photo)), SIDE)
    return encoded(color, alpha if float(alpha.min()) < _OPAQUE else None)


def scene_photo(path: Path) -> bytes:
    """Return a photo of a folder as it is upright; raise `InputError` when it cannot be read."""
    return encoded(shrink_area(read_ldr(path)[0], SIDE), None)


def encoded(color: np.ndarray, alpha: np.ndarray | None) -> bytes:
    """Return linear straight colour (H, W, 3) as JPEG, or with its alpha (H, W) as PNG."""
    values = np.rint(255 * srgb_encode(np.clip(color, 0, 1))).astype(np.uint8)
    buffer = io.BytesIO()
    if alpha is None:
        Image.fromarray(values).save(buffer, "JPEG", quality=90)
    else:
        cover = np.rint(255 * np.clip(alpha, 0, 1)).astype(np.uint8)
        Image.fromarray(np.dstack([values, cover])).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


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

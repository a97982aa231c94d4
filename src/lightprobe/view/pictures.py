"""Photos as the page shows them: decoded by our own reader, upright, in sRGB, small."""

import io
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.imaging import read_ldr, shrink_area, srgb_encode
from lightprobe.scene import new_photo
from lightprobe.scene.pixels import load_thumbnail
from lightprobe.view.sources import RunPhoto, RunSource

SIDE = 1024  # pixels of the longer side
_OPAQUE = 0.99  # alpha from which a photo counts as not cut out


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

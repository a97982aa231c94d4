"""Plain photos without cameras: crops of one large random picture, as a camera that pans over it would take."""

import numpy as np
import scipy
from PIL import Image

_RNG = np.random.default_rng(12)
_BLOBS = scipy.ndimage.gaussian_filter(_RNG.normal(size=(700, 2600)), 2.5)
WALL = np.clip(128 + 60 * _BLOBS / _BLOBS.std(), 0, 255)


def view(index, size=(640, 480)):
    """The picture (h, w) that the camera takes at its place `index`."""
    left, top = 30 * index % 1900, 9 * index % 200
    return WALL[top : top + size[1], left : left + size[0]]


def save(path, grey, *, focal_35=26, exposure=None):
    """Write a grey picture as a photo with EXIF."""
    exif = Image.Exif()
    tags = {} if focal_35 is None else {0xA405: focal_35}
    if exposure is not None:
        tags |= {0x829A: exposure, 0x829D: 4.0, 0x8827: 100}
    exif.get_ifd(0x8769).update(tags)
    color = np.clip(np.dstack([grey] * 3), 0, 255).astype(np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(color).save(path, quality=92, exif=exif.tobytes())


def take(folder, count, **options):
    """Write `count` good photos."""
    for index in range(count):
        save(folder / f"p{index:02d}.jpg", view(index), **options)
    return folder

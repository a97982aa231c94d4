"""Measure how sharp, textured and alike the photos of scenes are, as they are and blurred.

    python tools/measure_plain_photos.py FOLDER ...

Prints a row of a table for each folder of photos: the least, a tenth, the median and the greatest sharpness;
the median under blurs of one, two and four pixels and a motion of nine; the least and the median texture; and
the least difference of two photos. The bounds of `lightprobe inspect` for plain photos rest on these
(docs/decisions/plain-photos.md).
"""

import argparse
from pathlib import Path

import numpy as np
import scipy

from lightprobe.imaging import LUMA, read_ldr, shrink_area, srgb_encode
from lightprobe.imaging.video import difference
from lightprobe.scene.frame import Problems, list_images
from lightprobe.scene.plain_photos import measure_photos, sharpness

_MOST, _BLURRED = 96, 12  # photos of a folder that are measured, and that are blurred
_SIDE = 1280  # pixels that a blurred photo is reduced to, as others are
_HEAD = "| photos | sharpness | blur 1 | blur 2 | blur 4 | motion | texture | least difference |"


def row(folder: Path) -> str:
    """Return the row of the table for a folder of photos."""
    files = list_images(folder)[:_MOST]
    photos = measure_photos(files, Problems())
    sharp = np.percentile([photo.sharpness for photo in photos], [0, 10, 50, 100])
    textures = np.percentile([photo.texture for photo in photos], [0, 50])
    pairs = [difference(a.thumbnail, b.thumbnail) for i, a in enumerate(photos) for b in photos[:i]]
    spoilt = np.median([_blurred(path) for path in files[:: -(-len(files) // _BLURRED)]], axis=0)
    cells = [f"{len(photos)} of {folder}", _listed(sharp), *(f"{value:.2f}" for value in spoilt)]
    return f"| {' | '.join([*cells, _listed(textures, 3), f'{min(pairs, default=np.nan):.3f}'])} |"


def _blurred(path: Path) -> list[float]:
    """Return the sharpness of a photo under three blurs and a motion, in linear light."""
    color, _ = read_ldr(path)
    views = [scipy.ndimage.gaussian_filter(color, (sigma, sigma, 0)) for sigma in (1, 2, 4)]
    views.append(scipy.ndimage.uniform_filter1d(color, 9, axis=1))
    return [sharpness(np.clip(srgb_encode(shrink_area(view @ LUMA, _SIDE)), 0, 1) * 255) for view in views]


def _listed(values: np.ndarray, digits: int = 2) -> str:
    return " / ".join(f"{value:.{digits}f}" for value in values)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Measure photos as `lightprobe inspect` does.")
    parser.add_argument("folders", nargs="+", type=Path, help="folders of photos")
    print(_HEAD + "\n" + "| --- " * _HEAD.count(" | ") + "| --- |")
    for folder in parser.parse_args().folders:
        print(row(folder), flush=True)


if __name__ == "__main__":
    main()

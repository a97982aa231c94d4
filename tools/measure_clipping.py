"""How many reduced pixels of the object hold a clipped source pixel, and how many are marked so.

    python tools/measure_clipping.py SCENE...           # at the sizes of the three passes of preset quick

A row for each scene and size: of the pixels that lie wholly inside the mask, the share in which some channel of some
source pixel is clipped, counted one by one; the share that Phase I takes for clipped; and, for comparison, the share
whose average is as bright as a clipped pixel. All in percent, over all training photos.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from lightprobe.core.config.reconstruction import quick
from lightprobe.core.errors import LightprobeError
from lightprobe.reconstruction.photos import load_targets
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.photo import CLIPPED, Photo, Scene

_INSIDE = 0.99  # coverage from which a pixel lies wholly inside the mask


def counted(clipped: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return which of height x width pixels overlap a True of `clipped` (H, W), (height, width) bool."""
    found = np.zeros((height, width), bool)
    rows, columns = (
        size * np.arange(count + 1) / count for size, count in zip(clipped.shape, found.shape, strict=True)
    )
    for i in range(height):
        band = np.asarray(clipped[int(rows[i]) : int(np.ceil(rows[i + 1] - 1e-9))].any(0))
        for j in range(width):
            found[i, j] = band[int(columns[j]) : int(np.ceil(columns[j + 1] - 1e-9))].any()
    return found


def shares(scene: Scene, photo: Photo, side: int) -> np.ndarray:
    """Return the numbers (4,) of pixels inside the mask, truly clipped, marked as clipped, and of a clipped average."""
    (target,) = load_targets(scene, [photo], side, torch.device("cpu"))
    height, width = target.view.height, target.view.width
    inside = (target.alpha > _INSIDE).numpy()
    whole = load_pixels(photo)[0]
    source = (whole.color >= CLIPPED).any(-1) & (whole.alpha > 0)
    true = counted(source, height, width).ravel()
    average = (target.color >= CLIPPED * target.alpha[:, None]).any(1).numpy()
    marked = target.clipped.any(1).numpy()
    return np.array([inside.sum(), *((part & inside).sum() for part in (true, marked, average))])


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    given = parser.parse_args(arguments)
    config = quick()
    print("| scene | side | true, % | marked, % | clipped average, % |\n| --- | ---: | ---: | ---: | ---: |")
    try:
        for path in given.scenes:
            scene = load_scene(path)
            for side in (config.pass1_side, config.pass2_side, config.pass3_side):
                inside, *found = np.sum([shares(scene, photo, side) for photo in scene.train], axis=0)
                print(f"| {path.name} | {side} | {' | '.join(f'{100 * n / inside:.2f}' for n in found)} |", flush=True)
    except LightprobeError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()

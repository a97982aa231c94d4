"""The NeRD / LLFF layout: `poses_bounds.npy`, one row per photo of `images/` in sorted order, and `masks/`.

A row is 15 pose values and two depth bounds (not needed here). The pose is 3x5 with the columns
[down, right, backwards, position, (height, width, focal)], camera to world.
"""

from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError, shown
from lightprobe.core.reading import LARGEST_TEXT, check_file
from lightprobe.scene.camera import Camera
from lightprobe.scene.frame import Frame, list_images

POSES = "poses_bounds.npy"


def read_nerd(root: Path) -> list[Frame]:
    """Return the frames of a NeRD/LLFF folder; raise `InputError` when poses and photos do not match."""
    path = root / POSES
    check_file(path, LARGEST_TEXT)
    rows = _rows(path)
    images = list_images(root / "images") if (root / "images").is_dir() else []
    if len(images) != len(rows):
        raise InputError(f"{path} holds {len(rows)} poses, but {root / 'images'} holds {len(images)} photos.")
    pairs = enumerate(zip(rows, images, strict=True))
    return [_frame(path, index, row, image) for index, (row, image) in pairs]


def _rows(path: Path) -> np.ndarray:
    """Return the array (N, 15 | 17) float64 of the file; raise `InputError` for anything else."""
    try:
        # Unlike `np.load` this opens nothing but an array, and reserves no memory for a broken header.
        rows = np.lib.format.open_memmap(path, mode="r")
    except Exception as error:  # whatever NumPy's parser of a header runs into
        reason = shown(str(error) or type(error).__name__).rstrip(".")
        raise InputError(f"{path} cannot be read as a NumPy array: {reason}.") from error
    if rows.ndim != 2 or rows.shape[1] not in (15, 17) or rows.dtype.kind not in "fiu":
        kind = shown(str(rows.dtype))
        raise InputError(
            f"{path} must hold 17 numbers per photo, but its shape is {rows.shape} and its type {kind}."
        )
    return np.array(rows, np.float64)


def _frame(path: Path, index: int, row: np.ndarray, image: Path) -> Frame:
    source = f"{path} row {index} ({image.name})"
    pose = row[:15].reshape(3, 5)
    down, right, back, position, size = pose.T

    def camera(width: int, height: int) -> Camera:
        if not np.isfinite(pose).all():
            raise InputError(
                f"{source} contains NaN or infinity; estimate this pose again or remove the photo."
            )
        to_world = np.eye(4)
        to_world[:3] = np.stack([right, -down, back, position], axis=1)
        rows, columns, focal = (float(value) for value in size)
        return Camera(to_world, focal, focal, columns / 2, rows / 2, round(columns), round(rows))

    return Frame(image, source, camera)

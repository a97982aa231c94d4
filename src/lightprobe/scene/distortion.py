"""A photo's lens undone: the pinhole camera that the photo is resampled to, and the resampling.

That camera has the photo's size and principal point; its focal length is reduced so that the middles of all
four edges of the photo stay in the picture, at most by half. What lies further out is lost; where the photo
ends first, nothing is covered. Distortion below a thousandth of the image size, which is below the error of
poses, is left alone.
"""

from dataclasses import replace

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.scene.camera import Camera
from lightprobe.scene.lens import Lens

_TOLERANCE = 1e-3  # of the longer image side: below the error of the poses themselves
_LEAST_ZOOM = 0.5  # below it a fisheye's middle would get too few pixels
ADVICE = "undistort the photos first (for instance with `colmap image_undistorter`) and use the result"


def with_lens(camera: Camera, lens: Lens, *, source: str) -> Camera:
    """Return the pinhole camera for a photo taken through `lens`, whose intrinsics `camera` has.

    It carries the lens unless that bends too little to be seen. Raises `InputError` naming `source` for a
    lens that folds the picture over within its borders: such coefficients come from a failed estimate.
    """
    if lens.is_pinhole:
        return camera
    lens.check(source)
    if _largest_shift(camera, lens) <= _TOLERANCE * max(camera.width, camera.height):
        return camera
    edges = _edges(camera)
    fold = lens.fold_radius()
    if np.isfinite(fold):
        axes = edges / np.linalg.norm(edges, axis=1, keepdims=True)
        reach = (lens.distort(fold * axes) * axes).sum(axis=1)
        if not (reach >= 0.99 * np.linalg.norm(edges, axis=1)).all():
            raise InputError(
                f"{source} has lens distortion that folds the picture over within its borders, as no lens does; "
                "estimate the camera again, with fewer coefficients."
            )
    inside = lens.undistort(edges)
    growth = np.linalg.norm(inside, axis=1) / np.linalg.norm(edges, axis=1)
    zoom = float(np.clip(1 / np.nan_to_num(growth, nan=1 / _LEAST_ZOOM).max(), _LEAST_ZOOM, 1))
    return replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom, lens=replace(lens, zoom=zoom))


class Resampling:
    """Where the pixels of a camera with a lens lie in its photo, a few rows at a time."""

    def __init__(self, camera: Camera):
        if camera.lens is None:
            raise ValueError("The camera has no lens.")
        self._camera, self._lens, self._fold = camera, camera.lens, camera.lens.fold_radius()

    def places(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Return where the pixels of the rows first..last - 1 lie in the photo, and which of them it shows.

        (h, W, 2) float64 x, y in the photo's pixels, centres at halves, held within the photo; (h, W) bool.
        """
        camera, lens = self._camera, self._lens
        u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(first, last) + 0.5)
        points = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], axis=-1)
        bent = np.nan_to_num(lens.distort(points), nan=1e9, posinf=1e9, neginf=-1e9)
        photo = bent * (camera.fx / lens.zoom, camera.fy / lens.zoom) + (camera.cx, camera.cy)
        size = np.array([camera.width, camera.height])
        shown = ((photo >= 0) & (photo <= size)).all(axis=-1) & (np.linalg.norm(points, axis=-1) < self._fold)
        return np.clip(photo, 0.5, size - 0.5), shown


def span(places: np.ndarray, shown: np.ndarray) -> tuple[int, int]:
    """Return (first, last) of the photo's rows that `bilinear` needs for the `shown` places (h, W, 2)."""
    rows = places[..., 1][shown]
    if not rows.size:
        return 0, 1
    return int(np.floor(rows.min() - 0.5)), int(np.floor(rows.max() - 0.5)) + 2


def bilinear(planes: np.ndarray, top: int, places: np.ndarray) -> np.ndarray:
    """Return the values of `planes` (h, W, C), the photo's rows from `top` on, at `places` (..., 2)."""
    height, width = planes.shape[:2]
    x, y = places[..., 0] - 0.5, places[..., 1] - 0.5 - top
    left = np.clip(np.floor(x), 0, max(width - 2, 0)).astype(np.intp)
    above = np.clip(np.floor(y), 0, max(height - 2, 0)).astype(np.intp)
    across = np.clip(x - left, 0, 1).astype(np.float32)[..., None]
    down = np.clip(y - above, 0, 1).astype(np.float32)[..., None]
    flat = planes.reshape(height * width, -1)
    corner = above * width + left
    right, below = min(1, width - 1), width * min(1, height - 1)

    def row(left: np.ndarray) -> np.ndarray:
        return np.take(flat, left, axis=0) * (1 - across) + np.take(flat, left + right, axis=0) * across

    return row(corner) * (1 - down) + row(corner + below) * down


def _edges(camera: Camera) -> np.ndarray:
    """Return the middles of the image's edges on the image plane, (4, 2), beside the axis if it is there."""
    w, h = camera.width, camera.height
    cx, cy = np.clip(camera.cx, 0.1 * w, 0.9 * w), np.clip(camera.cy, 0.1 * h, 0.9 * h)
    pixels = np.array([[0, cy], [w, cy], [cx, 0], [cx, h]])
    return (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)


def _largest_shift(camera: Camera, lens: Lens) -> float:
    """Return by how many pixels the lens moves some point of the image; NaN or inf where that overflows."""
    u, v = np.meshgrid(np.linspace(0, camera.width, 9), np.linspace(0, camera.height, 9))
    points = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], axis=-1)
    shift = (lens.distort(points) - points) * (camera.fx, camera.fy)
    return float(np.linalg.norm(shift, axis=-1).max())

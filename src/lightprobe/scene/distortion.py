"""A photo's lens undone: the pinhole camera that the photo is resampled to, and the resampling.

That camera has the photo's size and principal point; its focal length is reduced so that the middles of all
four edges of the photo stay in the picture, at most by half. What lies further out is lost; where the photo
ends first, nothing is covered. Distortion below a thousandth of the image size, which is below the error of
poses, is left alone.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from lightprobe.core.errors import InputError
from lightprobe.imaging.resize import bilinear_grid
from lightprobe.scene.camera import Camera
from lightprobe.scene.lens import Lens

_TOLERANCE = 1e-3  # of the longer image side: below the error of the poses themselves
_LEAST_ZOOM = 0.5  # below it a fisheye's middle would get too few pixels
_KNOT, _FEWEST_KNOTS = 8, 160  # pixels between places that a lens is computed for; and across a small picture
_OFF = 1e3  # focal lengths from the axis: far outside of every photo
ADVICE = "undistort the photos first (for instance with `colmap image_undistorter`) and use the result"


def with_lens(camera: Camera, lens: Lens, *, source: str) -> Camera:
    """Return the pinhole camera for a photo taken through `lens`, whose intrinsics `camera` has.

    It carries the lens unless that bends too little to be seen. Raises `InputError` naming `source` for a
    lens that folds the picture over within the pinhole's borders: such coefficients come from a failed estimate. Of
    one that folds it further out, as a polynomial of few coefficients does for a very wide lens, the picture ends there.
    """
    if lens.is_pinhole:
        return camera
    lens.check(source)
    if _largest_shift(camera, lens) <= _TOLERANCE * max(camera.width, camera.height):
        return camera
    edges, fold = _edges(camera), lens.fold_radius()
    length = np.linalg.norm(edges, axis=1)
    if np.isfinite(fold):
        axes = edges / length[:, None]
        reach = (lens.distort(fold * axes) * axes).sum(axis=1)
        if not ((reach >= 0.99 * length) | (fold > length)).all():
            raise InputError(
                f"{source} has lens distortion that folds the picture over within its borders, as no lens does; "
                "estimate the camera again, with fewer coefficients."
            )
    inside = np.linalg.norm(lens.undistort(edges), axis=1)  # NaN where no point is moved to an edge
    growth = np.fmin(
        inside / length, fold / length.max()
    )  # where the fold lies within the photo, the picture ends there
    zoom = float(np.clip(1 / growth.max(), _LEAST_ZOOM, 1))
    return replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom, lens=replace(lens, zoom=zoom))


class Resampling:
    """Where the pixels of a camera with a lens lie in its photo, a few rows at a time."""

    def __init__(self, camera: Camera):
        if camera.lens is None:
            raise ValueError("The camera has no lens.")
        self._camera, self._fold = camera, camera.lens.fold_radius()
        self._knots = knots(camera.width, camera.height, self._in_photo)

    def places(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Return where the pixels of the rows first..last - 1 lie in the photo, and which of them it shows.

        (h, W, 2) float32 x, y in the photo's pixels, centres at halves, held within the photo; (h, W) bool.
        """
        camera, rows = self._camera, np.arange(first, last) + 0.5
        columns = np.arange(camera.width) + 0.5
        photo = between_knots(self._knots, rows / camera.height, columns / camera.width)
        size = np.array([camera.width, camera.height], np.float32)
        held = np.clip(photo, 0, size)
        shown = (held[..., 0] == photo[..., 0]) & (held[..., 1] == photo[..., 1])
        if np.isfinite(self._fold):
            x, y = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
            shown &= x * x + (y * y)[:, None] < self._fold**2
        return np.clip(held, np.float32(0.5), size - np.float32(0.5), out=held), shown

    def _in_photo(self, points: np.ndarray) -> np.ndarray:
        """Return where points (..., 2) of the pinhole's picture lie in the photo; far outside where that overflows."""
        camera, lens = self._camera, self._camera.lens
        if lens is None:
            raise ValueError("The camera has no lens.")
        focal, center = np.array([camera.fx, camera.fy]), (camera.cx, camera.cy)
        bent = np.nan_to_num(lens.distort((points - center) / focal), nan=_OFF, posinf=_OFF, neginf=-_OFF)
        return np.clip(bent, -_OFF, _OFF) * focal / lens.zoom + center


def knots(width: int, height: int, move: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return where `move` takes points (n, m, 2), pixels, of a grid that is laid over a picture, (n, m, 2) float32.

    In between, a lens departs from straight lines by a few hundredths of a pixel at most.
    """
    across, down = (max(-(-side // _KNOT), _FEWEST_KNOTS) + 1 for side in (width, height))
    return move(
        np.stack(np.meshgrid(np.linspace(0, width, across), np.linspace(0, height, down)), -1)
    ).astype(np.float32)


def between_knots(found: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return what `knots` returned, between them: (n, m, 2) float32 at shares of the height (n,) and width (m,)."""
    down, across = found.shape[:2]
    return bilinear_grid(found, rows * (down - 1), columns * (across - 1))


def span(places: np.ndarray, shown: np.ndarray) -> tuple[int, int]:
    """Return (first, last) of the photo's rows that `bilinear` needs for the `shown` places (h, W, 2)."""
    rows = places[..., 1][shown]
    if not rows.size:
        return 0, 1
    return int(np.floor(rows.min() - 0.5)), int(np.floor(rows.max() - 0.5)) + 2


def bilinear(planes: np.ndarray, top: int, places: np.ndarray) -> np.ndarray:
    """Return the values of `planes` (h, W, C) float32, the photo's rows from `top` on, at `places` (..., m, 2)."""
    height, width = planes.shape[:2]
    scale = np.array([2 / width, 2 / height], np.float32)  # PyTorch counts from -1 to 1, border to border
    around = (places - np.array([0, top], np.float32)) * scale - np.float32(1)
    grid = torch.from_numpy(around.astype(np.float32, copy=False)).reshape(1, -1, *places.shape[-2:])
    image = torch.from_numpy(planes).permute(2, 0, 1)[None]
    found = torch.nn.functional.grid_sample(image, grid, padding_mode="border", align_corners=False)
    return found[0].permute(1, 2, 0).numpy().reshape(*places.shape[:-1], -1)


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

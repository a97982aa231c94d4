"""How two photos of known cameras constrain each other."""

from collections.abc import Mapping, Sequence

import numpy as np

from lightprobe.preparation.features import Features
from lightprobe.preparation.mapping import straightened
from lightprobe.scene.camera import Camera

_OFF = 0.003  # of the longer side: distance from the epipolar line up to which a match fits
_WIDEST = 60.0  # degrees between viewing directions: beyond, hardly a match is right


def match_tolerance(width: int, height: int) -> float:
    """Return how many pixels a match that fits may lie off its epipolar line, in a picture of this size."""
    return _OFF * max(width, height)


def same_side(first: Camera, second: Camera) -> bool:
    """Tell whether two cameras see enough of the same side of a thing for right matches."""
    apart = first.camera_to_world[:3, 2] @ second.camera_to_world[:3, 2]
    return bool(apart > np.cos(np.radians(_WIDEST)))


def epipolar_distance(
    photos: Sequence[Features],
    pair: tuple[int, int],
    rows: np.ndarray,
    cameras: Mapping[int, Camera],
    bends: Mapping[int, float],
) -> np.ndarray:
    """Return Sampson's distance (M,) of matches from their cameras' epipolar geometry, pixels."""
    (i, j), first, second = pair, cameras[pair[0]], cameras[pair[1]]

    def rays(k: int, column: int) -> np.ndarray:
        """Return image points as (x / z, y / z, 1) with y down, (M, 3)."""
        camera, points = cameras[k], photos[k].points[rows[:, column]].astype(np.float64)
        plane = (straightened(points, camera, bends[k]) - [camera.cx, camera.cy]) / camera.fx
        return np.concatenate([plane, np.ones((len(rows), 1))], 1)

    x, y = rays(i, 0), rays(j, 1)
    flip = np.diag([1.0, -1.0, -1.0])
    turn = flip @ second.camera_to_world[:3, :3].T @ first.camera_to_world[:3, :3] @ flip
    shift = flip @ second.camera_to_world[:3, :3].T @ (first.position - second.position)
    tx, ty, tz = shift / max(float(np.linalg.norm(shift)), 1e-12)
    essential = np.array([[0, -tz, ty], [tz, 0, -tx], [-ty, tx, 0]]) @ turn
    there, back = x @ essential.T, y @ essential
    slope = there[:, 0] ** 2 + there[:, 1] ** 2 + back[:, 0] ** 2 + back[:, 1] ** 2
    distance = np.abs((y * there).sum(1)) / np.sqrt(np.maximum(slope, 1e-18))
    return distance * first.fx

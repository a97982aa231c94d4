"""Cameras that no photo has: all around the object, and along a turntable."""

import math

import numpy as np

from lightprobe.scene.camera import Camera, up_of


def look_at(position: np.ndarray, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the camera-to-world pose (4, 4) at `position` (3,) that looks at `target` with `up` upwards."""
    back = np.asarray(position, np.float64) - target
    back = back / np.linalg.norm(back)
    right = np.cross(up, back)
    if np.linalg.norm(right) < 1e-6:  # looking along the up direction: any right vector will do
        right = np.cross(np.eye(3)[np.argmin(np.abs(back))], back)
    right = right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, position], axis=1)
    return pose


def surrounding(count: int, side: int, radius: float, distance: float = 4.0) -> list[Camera]:
    """Return `count` square cameras evenly all around the origin that each see a ball of `radius` whole.

    They stand on a Fibonacci sphere at `distance` radii.
    """
    number = np.arange(count) + 0.5
    z, turn = 1 - 2 * number / count, math.pi * (1 + math.sqrt(5)) * number
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    focal = _filling_focal(side, distance)
    up, origin = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    poses = [look_at(distance * radius * direction, origin, up) for direction in directions]
    return [Camera(pose, focal, focal, side / 2, side / 2, side, side) for pose in poses]


def turntable(photos: list[Camera], center: np.ndarray, frames: int, side: int) -> list[Camera]:
    """Return cameras circling `center` (3,) at the photos' median distance, height and framing, up as in the
    photos.

    The axis of the circle is the mean upward direction of the photos, so frames stand upright in any user's
    frame.
    """
    up = up_of(photos)
    offsets = np.array([camera.position - center for camera in photos])
    distance = float(np.median(np.linalg.norm(offsets, axis=1)))
    elevation = float(np.clip(np.median(offsets @ up / np.linalg.norm(offsets, axis=1)), -0.9, 0.9))
    sideways = offsets - (offsets @ up)[:, None] * up
    beside = np.linalg.norm(sideways, axis=1)
    first = int(np.argmax(beside > 1e-3 * distance))  # a camera right above the object shows no way to begin
    start = sideways[first] / beside[first] if beside[first] > 0 else look_at(up, np.zeros(3), up)[:3, 0]
    across = np.cross(up, start)
    focal = side * float(np.median([camera.fx / max(camera.width, camera.height) for camera in photos]))
    cameras = []
    for turn in 2 * math.pi * np.arange(frames) / frames:
        around = math.cos(turn) * start + math.sin(turn) * across
        position = center + distance * (elevation * up + math.sqrt(1 - elevation**2) * around)
        cameras.append(Camera(look_at(position, center, up), focal, focal, side / 2, side / 2, side, side))
    return cameras


def _filling_focal(side: int, distance: float) -> float:
    """Focal length in pixels with which a unit ball at `distance` fills 98 % of a square image."""
    return 0.98 * 0.5 * side * math.sqrt(distance**2 - 1)

"""Points on a ball and cameras around it, as structure from motion would hand them on, without a single
picture.
"""

import numpy as np

from lightprobe.preparation.features import Features
from lightprobe.preparation.mapping import Solution
from lightprobe.scene.camera import Camera
from tests.shapes import camera_at

SIZE = 200


def ring_cameras(count: int, height: float = 0.8) -> list[Camera]:
    """Return level cameras around the origin."""
    angles = 2 * np.pi * np.arange(count) / count
    return [camera_at((3 * np.cos(a), 3 * np.sin(a), height), size=SIZE, focal=300) for a in angles]


def ball_points(count: int, seed: int = 0) -> np.ndarray:
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True) * 0.7


def disc(camera: Camera, radius: float = 0.7) -> np.ndarray:
    """Return the ball's true mask (h, w) bool: a cone around the ray to its centre."""
    rows, columns = np.mgrid[:SIZE, :SIZE] + 0.5
    rays = np.stack(
        [(columns - camera.cx) / camera.fx, -(rows - camera.cy) / camera.fy, -np.ones((SIZE, SIZE))], -1
    )
    rays = rays @ camera.camera_to_world[:3, :3].T
    cosine = -(rays @ camera.position) / np.linalg.norm(rays, axis=-1) / np.linalg.norm(camera.position)
    return cosine > np.sqrt(1 - (radius / np.linalg.norm(camera.position)) ** 2)


def photographed(cameras: list[Camera], points: np.ndarray) -> tuple[list[Features], dict, Solution]:
    """Return features, matches of neighbours and the true solution; every photo sees every point."""
    none = np.zeros((len(points), 128), np.uint8)
    places = [camera.project(points)[:, :2].astype(np.float32) for camera in cameras]
    features = [Features(place, none, SIZE, SIZE) for place in places]
    rows = np.repeat(np.arange(len(points), dtype=np.uint32)[:, None], 2, axis=1)
    pairs = {(i, i + 1): rows for i in range(len(cameras) - 1)}
    everything = np.tile(np.arange(len(points)), len(cameras))
    photo = np.repeat(np.arange(len(cameras)), len(points))
    return features, pairs, true_solution(cameras, points, photo, everything, everything)


def true_solution(
    cameras: list[Camera], points: np.ndarray, seen_by: np.ndarray, feature: np.ndarray, seen: np.ndarray
) -> Solution:
    """Return the solution of straight cameras, one a photo, and of points (P, 3) that are seen as told."""
    return Solution(
        np.arange(len(cameras)),
        np.stack([c.camera_to_world for c in cameras]),
        np.array([[c.fx, c.cx, c.cy, 0.0] for c in cameras]),
        np.array([[c.width, c.height] for c in cameras]),
        points,
        np.full(len(points), 0.3),
        seen_by,
        feature,
        seen,
    )

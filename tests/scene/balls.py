"""Masks of a ball at the origin, from cameras around it."""

import numpy as np

from tests.shapes import camera_at

DIRECTIONS = [(1, 0, 0.2), (-1, 0.3, 0), (0, 1, -0.2), (0.1, -1, 0.1)]
DIRECTIONS += [(0.7, 0.7, 1), (-0.6, 0.5, -1), (0.5, -0.6, 1.2)]


def disc(camera, radius):
    """The mask of a ball at the origin: pixels whose ray passes closer than its radius."""
    v, u = np.mgrid[: camera.height, : camera.width] + 0.5
    local = np.stack([(u - camera.cx) / camera.fx, -(v - camera.cy) / camera.fy, -np.ones_like(u)], -1)
    rays = local @ camera.camera_to_world[:3, :3].T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    along = -(rays @ camera.position)
    return (camera.position @ camera.position - along**2 < radius**2).astype(np.float32)


def ball_views(radius=0.7, **options):
    cameras = [camera_at(3.5 * np.array(d) / np.linalg.norm(d), **options) for d in DIRECTIONS]
    return cameras, [disc(camera, radius) for camera in cameras]

"""What structure from motion found: cameras of photos, points in space, and which features see them.

Pixels are those of the working pictures; cameras have OpenGL's axes (x right, y up, looking along -z). Lens:
x' = x (1 + k r^2) in units of the focal length, COLMAP's SIMPLE_RADIAL.
"""

from dataclasses import dataclass, replace

import numpy as np

from lightprobe.scene.camera import Camera


@dataclass(frozen=True)
class Solution:
    """K cameras, P points and T sightings of points."""

    photo: np.ndarray  # (K,) int64, index of the photo of each camera, ascending
    pose: np.ndarray  # (K, 4, 4) float64 camera to world
    lens: np.ndarray  # (K, 4) float64: focal length, principal point x and y, k
    size: np.ndarray  # (K, 2) int64: width and height of the working picture
    points: np.ndarray  # (P, 3) float64
    errors: np.ndarray  # (P,) float64, mean reprojection error in pixels
    seen_by: np.ndarray  # (T,) int64, index of a photo
    feature: np.ndarray  # (T,) int64, index of its feature
    seen: np.ndarray  # (T,) int64, index of a point

    def cameras(self) -> dict[int, Camera]:
        """Return the pinhole part of each camera by the index of its photo."""
        return {
            int(photo): Camera(pose, f, f, cx, cy, int(width), int(height))
            for photo, pose, (f, cx, cy, _), (width, height) in zip(
                self.photo, self.pose, self.lens, self.size, strict=True
            )
        }

    def distortion(self) -> dict[int, float]:
        """Return the lens' k by the index of the photo."""
        return {int(photo): float(row[3]) for photo, row in zip(self.photo, self.lens, strict=True)}

    def mapped(self, rotation: np.ndarray, scale: float = 1.0) -> "Solution":
        """Return the solution with the world turned by `rotation` (3, 3), then scaled."""
        pose = self.pose.copy()
        pose[:, :3, :3] = rotation @ pose[:, :3, :3]
        pose[:, :3, 3] = scale * pose[:, :3, 3] @ rotation.T
        return replace(self, pose=pose, points=scale * self.points @ rotation.T)


def bent(points: np.ndarray, camera: Camera, k: float) -> np.ndarray:
    """Return where a lens shows what a pinhole shows at `points` (N, 2), pixels."""
    x, y = (points[:, 0] - camera.cx) / camera.fx, (points[:, 1] - camera.cy) / camera.fy
    stretch = 1 + k * (x * x + y * y)
    return np.stack([camera.cx + camera.fx * x * stretch, camera.cy + camera.fy * y * stretch], 1)


def straightened(points: np.ndarray, camera: Camera, k: float) -> np.ndarray:
    """Return where a pinhole shows what the lens shows at `points` (N, 2), pixels: the inverse of `bent`."""
    start = np.stack([(points[:, 0] - camera.cx) / camera.fx, (points[:, 1] - camera.cy) / camera.fy], 1)
    straight = start.copy()
    for _ in range(20):  # a contraction for every lens that is not nearly a fisheye
        straight = start / np.maximum(1 + k * (straight**2).sum(1, keepdims=True), 0.1)
    return straight * [camera.fx, camera.fy] + [camera.cx, camera.cy]

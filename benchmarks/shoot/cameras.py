"""Where a person holds the telephone: around the object, higher and lower, nearer and farther, not quite level."""

import numpy as np

_STEP = np.radians(30)
_LARGEST = 8.0  # distance, in radii of the object: walls and people are farther


def look_from(position: np.ndarray, at: np.ndarray, roll: float) -> np.ndarray:
    """Return the camera-to-world matrix (4, 4), OpenGL axes, of a camera that looks at a point."""
    back = (position - at) / np.linalg.norm(position - at)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1] = (
        np.cos(roll) * right + np.sin(roll) * up,
        np.cos(roll) * up - np.sin(roll) * right,
    )
    pose[:3, 2], pose[:3, 3] = back, position
    return pose


def hand_held(
    points: np.ndarray, focal: float, height: int, count: int, rng: np.random.Generator
) -> list[np.ndarray]:
    """Return poses about 30 degrees apart in which the points (N, 3) fill 25 to 60 % of the picture's height."""
    poses, start = [], rng.uniform(0, 2 * np.pi)
    for k in range(count):
        azimuth = start + _STEP * (k + rng.uniform(-0.2, 0.2))
        elevation = np.radians((12, 30, 20, 45)[k % 4] + rng.uniform(-4, 8))
        towards = np.array(
            [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
        )
        share, aside, roll = rng.uniform(0.3, 0.58), rng.uniform(-0.2, 0.2, 3), np.radians(rng.normal(0, 2))
        distance = 4.0
        for _ in range(4):  # the share falls with the distance, not quite in proportion
            pose = look_from(distance * towards, aside, roll)
            local = (points - pose[:3, 3]) @ pose[:3, :3]
            size = np.ptp(focal * local[:, :2] / -local[:, 2:], axis=0).max() / height
            distance = min(distance * size / share, _LARGEST)
        poses.append(look_from(distance * towards, aside, roll))
    return poses

"""Which way is up, and how long is a metre: what structure from motion cannot tell and an environment map
needs.

Some telephones write which way their acceleration sensors felt up to be. Else people are taken to hold
cameras level: all x axes of the cameras are horizontal then, and up is the direction in which they vary
least; the y axes tell its sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.core.errors import ConfigError

_SURE = 0.2  # spread of the x axes along up over that across, beyond which cameras were not held level
_FEWEST_TOLD = 3  # photos whose sensors tell up: fewer may be one mistake
_AGREEING = 0.98  # length of the mean of their unit directions: within about eleven degrees of each other
_ARC = 0.05  # least spread across: cameras that all stand on one side leave the horizon open


@dataclass(frozen=True)
class Up:
    """A direction (3,) in the frame of the reconstruction, and where it comes from."""

    direction: np.ndarray  # (3,) float64 unit
    source: str
    doubt: str | None = None  # a sentence where it may be wrong


def up_of_level_cameras(poses: np.ndarray) -> Up:
    """Return the direction that is up when cameras (K, 4, 4), OpenGL axes, were held level."""
    right, above = poses[:, :3, 0], poses[:, :3, 1]
    values, vectors = np.linalg.eigh(right.T @ right / len(right))
    up, mean = vectors[:, 0], above.mean(axis=0)
    up = up if up @ mean >= 0 else -up
    source = "the cameras' horizons: photos are taken to be held level"
    if values[1] < _ARC:  # nearly parallel x axes: only their mean y axis is left
        mean = mean / max(float(np.linalg.norm(mean)), 1e-12)
        one_side = (
            "All photos are taken from nearly one side, so that up is only the mean of their vertical axes; give it "
            "with --up x,y,z or --up-photo."
        )
        return Up(mean, "the mean of the photos' vertical axes", one_side)
    doubt = None
    if np.sqrt(max(values[0], 0) / values[1]) > _SURE:
        doubt = (
            "The photos are not held level, so that up is uncertain; look at the report's mesh and give it with "
            "--up x,y,z or --up-photo."
        )
    return Up(up, source, doubt)


def up_of_gravity(poses: np.ndarray, gravity: Sequence[np.ndarray | None]) -> Up | None:
    """Return the mean direction that cameras' sensors call up, or None unless a few photos tell it and agree.

    poses (K, 4, 4), OpenGL axes; gravity: of each photo the direction (3,) up in its camera's axes, where its
    file has one (`imaging.gravity`).
    """
    told = [pose[:3, :3] @ up for pose, up in zip(poses, gravity, strict=True) if up is not None]
    if len(told) < _FEWEST_TOLD:
        return None
    mean = np.mean(told, axis=0)
    length = float(np.linalg.norm(mean))
    if length < _AGREEING:
        return None
    return Up(mean / length, f"the cameras' acceleration sensors, in {len(told)} photos")


def parse_up(text: str) -> np.ndarray:
    """Return the direction (3,) of `x,y,z`; raise `ConfigError` for anything else."""
    try:
        direction = np.array([float(part) for part in text.split(",")])
    except ValueError:
        direction = np.zeros(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not np.linalg.norm(direction) > 0:
        raise ConfigError(f"--up {text[:60]} is no direction; give three numbers such as 0,-1,0.")
    return direction / np.linalg.norm(direction)


def rotation_to_z(up: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) of `up` (3,) to z, and of the first camera (K, 4, 4) to the side of -y."""
    first = poses[0, :3, 2] - (poses[0, :3, 2] @ up) * up
    if np.linalg.norm(first) < 1e-6:
        first = poses[0, :3, 0] - (poses[0, :3, 0] @ up) * up
    y = -first / np.linalg.norm(first)
    return np.stack([np.cross(y, up), y, up])


def extent_along(points: np.ndarray, direction: Sequence[float] | np.ndarray) -> float:
    """Return how far points (P, 3) reach along a unit direction (3,)."""
    along = points @ np.asarray(direction)
    return float(np.ptp(along)) if len(along) else 0.0

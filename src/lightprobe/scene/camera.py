"""Pinhole cameras and the similarity between the user's frame and the normalised frame.

Notation: camera axes are OpenGL's (x right, y up, looking along -z); `camera_to_world` maps camera points to
world points; pixel (column j, row i) has its centre at (j + 0.5, i + 0.5) with row 0 at the top.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError, shown
from lightprobe.scene.lens import Lens

# Beyond these no camera has ever been, and arithmetic ends: a photo beyond them is damaged, not unusual.
_SIDE = 1_000_000  # pixels
_FOCAL = (
    0.05,
    1e5,
)  # least and greatest focal length, in the longer side of the image; the least is 169 degrees wide
_CENTER = 1e3  # distance of the principal point from the image's corner; photos may be crops of larger ones
_FAR = 1e12  # coordinates of a position, in the user's units

_AGREEING = 0.3  # length of the mean of unit axes from which they agree on a direction


@dataclass(frozen=True)
class Similarity:
    """Maps the input frame to the normalised frame: x_normalised = (x_input - center) / scale.

    It has no rotation, so directions, and with them environment maps, are the same in both frames.
    """

    center: np.ndarray  # (3,) float64, input units
    scale: float  # input units per normalised unit

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Map points (..., 3) from the input frame to the normalised frame."""
        return (np.asarray(points, np.float64) - self.center) / self.scale

    def invert(self, points: np.ndarray) -> np.ndarray:
        """Map points (..., 3) from the normalised frame back to the input frame."""
        return np.asarray(points, np.float64) * self.scale + self.center

    def to_json(self) -> dict[str, Any]:
        """Return a JSON value; `from_json` is its inverse."""
        return {"center": [float(c) for c in self.center], "scale": float(self.scale)}

    @staticmethod
    def from_json(value: Any, *, source: str = "scene.json") -> "Similarity":
        """Return the similarity written by `to_json`; `source` names the file in errors."""
        try:
            center, scale = np.asarray(value["center"], np.float64), float(value["scale"])
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise InputError(
                f"{source}: the similarity has no center of three numbers and one scale."
            ) from error
        if center.shape != (3,) or not np.isfinite(center).all() or not 0 < scale < np.inf:
            raise InputError(
                f"{source}: the similarity needs a finite center (3 numbers) and a scale above 0."
            )
        return Similarity(center, scale)


@dataclass(frozen=True)
class Camera:
    """One pinhole camera; intrinsics in pixels of an image of `width` x `height`.

    A photo taken through a lens that bends has the camera of the picture that it is resampled to.
    """

    camera_to_world: np.ndarray  # (4, 4) float64
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    lens: Lens | None = None  # how the photo's file departs from this pinhole; undone while it is read

    @property
    def position(self) -> np.ndarray:
        """Centre of projection, (3,) float64."""
        return self.camera_to_world[:3, 3]

    def resized(self, width: int, height: int) -> "Camera":
        """Return the camera of the same view in an image of another size."""
        sx, sy = width / self.width, height / self.height
        across, down = {"fx": self.fx * sx, "cx": self.cx * sx}, {"fy": self.fy * sy, "cy": self.cy * sy}
        return replace(self, width=width, height=height, **across, **down)  # type: ignore[arg-type]

    def scaled(self, factor: float) -> "Camera":
        """Return the camera of the same view with `factor` times as long sides, of at least a pixel."""
        return self.resized(*(max(1, round(side * factor)) for side in (self.width, self.height)))

    def within(self, side: int) -> "Camera":
        """Return the camera of the same view with sides of at most `side` pixels, itself where it fits."""
        longest = max(self.width, self.height)
        return self if longest <= side else self.scaled(side / longest)

    def normalised(self, similarity: Similarity) -> "Camera":
        """Return this input-frame camera in the normalised frame."""
        moved = self.camera_to_world.copy()
        moved[:3, 3] = similarity.apply(self.position)
        return replace(self, camera_to_world=moved)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project world points (N, 3) to (N, 3) float64: pixel x, y and depth along the view axis."""
        local = (np.asarray(points, np.float64) - self.position) @ self.camera_to_world[:3, :3]
        depth = -local[:, 2]
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        x, y = self.cx + self.fx * local[:, 0] / safe, self.cy - self.fy * local[:, 1] / safe
        return np.stack([x, y, depth], axis=-1)

    def framed(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return which points (N, 3) lie in the frame: indices, pixels' rows and columns, and depths, (K,) each."""
        x, y, depth = self.project(points).T
        shown = np.flatnonzero((depth > 0) & (x >= 0) & (y >= 0) & (x < self.width) & (y < self.height))
        return shown, y[shown].astype(int), x[shown].astype(int), depth[shown]

    def to_json(self) -> dict[str, Any]:
        """Return the camera as the JSON that `--camera` reads."""
        return {
            "camera_to_world": [[float(v) for v in row] for row in self.camera_to_world],
            **{key: getattr(self, key) for key in ("fx", "fy", "cx", "cy", "width", "height")},
            **({} if self.lens is None else {"lens": self.lens.to_json()}),
        }

    @staticmethod
    def from_json(value: Any, *, source: str) -> "Camera":
        """Return the camera of `to_json`'s form; `source` names the file in errors."""
        if not isinstance(value, dict):
            raise InputError(
                f"{source} must hold a JSON object with camera_to_world, fx, fy, cx, cy, width, height."
            )
        try:
            pose = np.asarray(value["camera_to_world"], np.float64)
            fx, fy, cx, cy = (float(value[key]) for key in ("fx", "fy", "cx", "cy"))
            lens = None if value.get("lens") is None else Lens.from_json(value["lens"], source=source)
            camera = Camera(pose, fx, fy, cx, cy, int(value["width"]), int(value["height"]), lens)
        except KeyError as error:
            raise InputError(
                f"{source} has no key {error}; a camera needs camera_to_world, fx, fy, cx, cy, width, height."
            ) from error
        except (TypeError, ValueError, OverflowError) as error:
            reason = shown(str(error)).rstrip(".")
            raise InputError(
                f"{source} holds a camera with a value that is not a number: {reason}."
            ) from error
        camera.check(source)
        return camera

    def check(self, source: str) -> None:
        """Raise `InputError` naming `source` unless the pose is rigid and the intrinsics are plausible."""
        pose = self.camera_to_world
        if pose.shape != (4, 4):
            shape = "x".join(map(str, pose.shape)) or "a number"
            raise InputError(f"{source}: camera_to_world must be a 4x4 matrix, not {shape}.")
        if not np.isfinite(pose).all() or not np.isfinite([self.fx, self.fy, self.cx, self.cy]).all():
            raise InputError(
                f"{source}: the camera contains NaN or infinity; estimate this pose again or remove the photo."
            )
        if not np.abs(self.position).max() <= _FAR:
            x, y, z = self.position
            raise InputError(
                f"{source}: the camera stands at ({x:.3g}, {y:.3g}, {z:.3g}), too far from the origin to compute with; "
                "estimate this pose again or remove the photo."
            )
        rotation = pose[:3, :3].clip(-2, 2)  # what is far beyond a rotation need not overflow
        if np.abs(rotation.T @ rotation - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
            raise InputError(
                f"{source}: camera_to_world is not a rotation (scaled, sheared or mirrored axes)."
            )
        if min(self.fx, self.fy) <= 0 or min(self.width, self.height) <= 0:
            raise InputError(f"{source}: focal lengths and image size must be positive.")
        longest = max(self.width, self.height)
        if longest > _SIDE:
            raise InputError(
                f"{source}: the image size is more than {_SIDE} pixels; give the size of the photo."
            )
        for focal in (self.fx, self.fy):
            if not _FOCAL[0] * longest <= focal <= _FOCAL[1] * longest:
                raise InputError(
                    f"{source}: no lens has a focal length of {focal:.3g} pixels for {self.width} x {self.height}; "
                    "give it in pixels of this image."
                )
        if not max(abs(self.cx), abs(self.cy)) <= _CENTER * longest:
            raise InputError(
                f"{source}: the principal point ({self.cx:.3g}, {self.cy:.3g}) lies absurdly far outside the "
                f"{self.width} x {self.height} pixels of the image; give it in pixels of this image."
            )


def mean_up(axes: Sequence[np.ndarray]) -> np.ndarray:
    """Return the mean direction (3,) float64 of cameras' upward axes (3,), or +z if they disagree."""
    up = np.mean(np.asarray(axes, np.float64), axis=0)
    length = float(np.linalg.norm(up))
    return up / length if length > _AGREEING else np.array([0.0, 0.0, 1.0])


def up_of(cameras: Iterable[Camera]) -> np.ndarray:
    """Return `mean_up` (3,) float64 of one camera or more."""
    return mean_up([camera.camera_to_world[:3, 1] for camera in cameras])

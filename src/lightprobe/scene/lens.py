"""Lenses that bend straight lines: where a pinhole camera's point falls in the photo, and back.

Notation: x, y a point on the pinhole's image plane at distance 1 (x right, y down, as OpenCV has it), r its
distance from the axis; x', y' where the lens moves it. Polynomial lenses (Brown, "Close-range camera
calibration", 1971; the models of OpenCV, COLMAP and nerfstudio):

    q  = (1 + a1 r^2 + a2 r^4 + a3 r^6 + a4 r^8 + ...) / (1 + b1 r^2 + b2 r^4 + b3 r^6)
    x' = x q + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + t1 r^4
    y' = y q + 2 p2 x y + p1 (r^2 + 2 y^2) + s2 r^2 + t2 r^4

Fisheye lenses first turn r into the angle from the axis (Kannala and Brandt, 2006): (x, y) atan(r) / r goes
into the same polynomial. So do those of COLMAP's model FOV (Devernay and Faugeras, "Straight lines have to be
straight", 2001), with atan(2 r tan(w/2)) / (r w), w being the angle. In COLMAP's RAD_TAN_THIN_PRISM_FISHEYE
(that of Project Aria's glasses) the terms after x q and y q are of the point (x q, y q). The photo's pixel is
(cx + fx x', cy + fy y').
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError

_WIDEST = np.tan(np.radians(85))  # r beyond which no pinhole picture goes
_STEPS, _AZIMUTHS = 600, 16  # samples of r and of directions in which a fold is looked for
_NEWTON_STEPS = 30  # at most; distortions of real lenses take four
_DIFFERENCE = 1e-6  # of r, for Newton's derivatives
_LARGEST = 1e6  # of a coefficient: beyond, a file is damaged


@dataclass(frozen=True)
class Lens:
    """How a lens departs from a pinhole."""

    radial: tuple[float, ...] = ()  # a1, a2, ...; at most six
    tangential: tuple[float, float] = (0.0, 0.0)  # p1, p2
    rational: tuple[float, ...] = ()  # b1, b2, b3
    prism: tuple[float, float] = (0.0, 0.0)  # s1, s2
    prism_fourth: tuple[float, float] = (0.0, 0.0)  # t1, t2
    fisheye: bool = False
    fov: float = 0.0  # w in radians, of which the model FOV has one; 0 for other lenses
    radial_first: bool = False  # whether tangential and prism terms are of the point after the polynomial
    zoom: float = 1.0  # focal length of the pinhole that the photo is resampled to, over the photo's own

    @property
    def is_pinhole(self) -> bool:
        """Whether nothing is bent."""
        return not self.fisheye and not any(self._numbers)

    @property
    def _numbers(self) -> tuple[float, ...]:
        return (*self.radial, *self.tangential, *self.rational, *self.prism, *self.prism_fourth, self.fov)

    def distort(self, points: np.ndarray) -> np.ndarray:
        """Return where the lens moves points (..., 2) of the image plane, float64; overflow is inf or NaN."""
        x, y = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            if self.fisheye or self.fov:
                r = np.hypot(x, y)
                squeeze = np.where(r > 1e-9, self._angle(r) / np.maximum(r, 1e-9), self._angle(1e-9) / 1e-9)
                x, y = x * squeeze, y * squeeze
            r2 = x * x + y * y
            q = _polynomial(self.radial, r2) / _polynomial(self.rational, r2)
            bent_x, bent_y = x * q, y * q
            if self.radial_first:
                x, y = bent_x, bent_y
                r2 = x * x + y * y
            (p1, p2), (s1, s2), (t1, t2) = self.tangential, self.prism, self.prism_fourth
            across = bent_x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + (s1 + t1 * r2) * r2
            down = bent_y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y) + (s2 + t2 * r2) * r2
            return np.stack([across, down], axis=-1)

    def _angle(self, r: Any) -> Any:
        """Return what a lens that measures angles makes of r."""
        return np.arctan(2 * r * np.tan(self.fov / 2)) / self.fov if self.fov else np.arctan(r)

    def undistort(self, points: np.ndarray) -> np.ndarray:
        """Return the points (..., 2) that `distort` moves to `points`, by Newton's method; NaN for none."""
        target = np.asarray(points, np.float64)
        found = target.copy()
        if self.fov:
            angle = np.linalg.norm(target, axis=-1, keepdims=True)
            r = np.tan(np.minimum(angle * self.fov, np.radians(84))) / (2 * np.tan(self.fov / 2))
            found = target * np.where(angle > 1e-9, r / np.maximum(angle, 1e-9), 1.0)
        elif self.fisheye:  # from the lens without its polynomial
            angle = np.minimum(np.linalg.norm(target, axis=-1, keepdims=True), np.radians(84))
            found = target * np.where(angle > 1e-9, np.tan(angle) / np.maximum(angle, 1e-9), 1.0)
        for _ in range(_NEWTON_STEPS):
            error = self.distort(found) - target
            step = np.linalg.solve(self._slopes(found), error[..., None])[..., 0]
            found = found - step
            if np.abs(step).max(initial=0) < 1e-13:
                break
        missed = np.abs(self.distort(found) - target).max(axis=-1, keepdims=True) > 1e-6
        return np.where(missed, np.nan, found)

    def fold_radius(self) -> float:
        """Return the least r at which the lens folds points back instead of spreading them, or infinity."""
        even = np.linspace(0, np.radians(85), _STEPS)
        radii = np.tan(even) if self.fisheye else np.linspace(0, _WIDEST, _STEPS)
        angles = np.linspace(0, 2 * np.pi, _AZIMUTHS, endpoint=False)
        axes = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        reached = (self.distort(radii[:, None, None] * axes) * axes).sum(axis=-1)  # (_STEPS, _AZIMUTHS)
        grows = (np.diff(reached, axis=0) > 0).all(axis=1)
        return float("inf") if grows.all() else float(radii[np.argmin(grows)])

    def to_json(self) -> dict[str, Any]:
        """Return a JSON value; `from_json` is its inverse."""
        lists = ("radial", "tangential", "rational", "prism")
        value: dict[str, Any] = {key: list(getattr(self, key)) for key in lists}
        value |= {"fisheye": self.fisheye, "zoom": self.zoom}
        # Only where a lens has them: records of other lenses stay those that earlier versions wrote.
        value |= {"prism_fourth": list(self.prism_fourth)} if any(self.prism_fourth) else {}
        value |= {"radial_first": True} if self.radial_first else {}
        return value | ({"fov": self.fov} if self.fov else {})

    @staticmethod
    def from_json(value: Any, *, source: str) -> "Lens":
        """Return the lens written by `to_json`; `source` names the file in errors."""
        try:
            value = {"prism_fourth": (0.0, 0.0), "fov": 0.0, "radial_first": False, **value}
            keys = ("radial", "tangential", "rational", "prism", "prism_fourth")
            lists: dict[str, Any] = {key: tuple(float(number) for number in value[key]) for key in keys}
            pairs = all(len(lists[key]) == 2 for key in ("tangential", "prism", "prism_fourth"))
            if not pairs or not isinstance(value["radial_first"], bool):
                raise ValueError(value)
            single: dict[str, Any] = {"fov": float(value["fov"]), "zoom": float(value["zoom"])}
            lens = Lens(**lists, **single, fisheye=bool(value["fisheye"]), radial_first=value["radial_first"])
        except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
            raise InputError(f"{source}: the lens is not described as lightprobe writes it.") from error
        is_long = len(lens.radial) > 6 or len(lens.rational) > 3
        if is_long or not 0.1 <= lens.zoom <= 1 or not np.isfinite(lens._numbers).all():
            raise InputError(f"{source}: the lens has values that no lens has.")
        return lens

    def check(self, source: str) -> None:
        """Raise `InputError` naming `source` when a coefficient is not finite or beyond all lenses."""
        if not all(abs(value) <= _LARGEST for value in self._numbers) or not 0 <= self.fov < np.pi:
            raise InputError(
                f"{source} has lens distortion with coefficients that no lens has; estimate the camera again."
            )

    def _slopes(self, points: np.ndarray) -> np.ndarray:
        """Return the derivatives (..., 2, 2) of `distort`, by central differences."""
        size = _DIFFERENCE * np.maximum(1.0, np.linalg.norm(points, axis=-1, keepdims=True))
        columns = [
            (self.distort(points + size * axis) - self.distort(points - size * axis)) / (2 * size)
            for axis in np.eye(2)
        ]
        slopes = np.stack(columns, axis=-1)
        singular = np.abs(np.linalg.det(np.nan_to_num(slopes))) < 1e-12
        singular |= ~np.isfinite(slopes).all(axis=(-2, -1))
        return np.where(singular[..., None, None], np.eye(2), slopes)


def _polynomial(coefficients: tuple[float, ...], r2: np.ndarray) -> np.ndarray:
    """Return 1 + c1 r^2 + c2 r^4 + ... by Horner's rule."""
    value = np.zeros_like(r2)
    for coefficient in reversed(coefficients):
        value = (value + coefficient) * r2
    return value + 1

"""The plane that the object stands on: a table, the ground."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.scene.camera import Similarity

_TILT = math.radians(3)  # between planes that count as one
_STEP = 0.05  # of the object's radius, between their offsets


@dataclass(frozen=True)
class SupportPlane:
    """A plane with the object on its positive side."""

    normal: np.ndarray  # (3,) float64, unit length
    offset: float

    def height(self, points: np.ndarray) -> np.ndarray:
        """Return how far above the plane `points` (..., 3) lie, (...) float64."""
        return points @ self.normal - self.offset

    def mapped(self, rotation: np.ndarray, scale: float) -> "SupportPlane":
        """Return the plane with the world turned by `rotation` (3, 3), then scaled."""
        return SupportPlane(rotation @ self.normal, scale * self.offset)

    def normalised(self, similarity: Similarity) -> "SupportPlane":
        """Return the plane in the normalised frame."""
        return SupportPlane(self.normal, float(self.height(similarity.center)) / -similarity.scale)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON value; `from_json` is its inverse."""
        return {"normal": self.normal.tolist(), "offset": float(self.offset)}

    @staticmethod
    def from_json(value: Any, *, source: str) -> "SupportPlane":
        """Return the plane written by `to_json`; `source` names the file in the `InputError` for any other value."""
        try:
            normal, offset = np.asarray(value["normal"], np.float64), float(value["offset"])
            length = float(np.linalg.norm(normal))
            usable = normal.shape == (3,) and 0 < length < math.inf and math.isfinite(offset)
        except (TypeError, ValueError, KeyError, OverflowError):
            usable = False
        if not usable:
            raise InputError(
                f"{source}: a support must have a 'normal' of three numbers that are not all 0, and a finite 'offset'."
            )
        return SupportPlane(normal / length, offset / length)


def common_support(planes: Sequence[SupportPlane | None], radius: float) -> SupportPlane | None:
    """Return the plane that all known `planes` agree on, None where one lies elsewhere or half of them are unknown.

    radius: of the object, in the planes' unit.
    """
    known = [plane for plane in planes if plane is not None]
    if 2 * len(known) <= len(planes):
        return None
    normal = np.mean([plane.normal for plane in known], axis=0)
    length = max(float(np.linalg.norm(normal)), 1e-12)
    middle = SupportPlane(normal / length, float(np.median([plane.offset for plane in known])))
    tilted = any(plane.normal @ middle.normal < math.cos(_TILT) for plane in known)
    apart = any(abs(plane.offset - middle.offset) > _STEP * radius for plane in known)
    return None if tilted or apart else middle

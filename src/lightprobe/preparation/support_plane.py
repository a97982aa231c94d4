"""The plane on which the object stands.

In most shoots the object stands the same way up everywhere; then the planes of all places are one in the object's
frame, and a place with a bare table takes that of the others.

    plane: normal . x = offset; height = normal . x - offset, positive on the object's side, in the cameras' unit
"""

from dataclasses import dataclass

import numpy as np

from lightprobe.preparation.mapping import Solution
from lightprobe.scene.support import SupportPlane

_NEAR = 3.0  # radii around the object's points within which its support shows
_THIN = 0.015  # of the object's radius: distance from a plane up to which a point lies on it
_FEWEST = 10  # points that make a plane: three fit any
_TRIALS = 2000  # of three points: enough where one point in seven lies on the plane
_BELOW = 0.05  # share of the object's points and of the cameras that may lie beneath: errors
_UNDER = 0.5  # radii of the object's points between a plane and the lowest of them, at most


def common_plane(solution: Solution, on_object: np.ndarray, seed: int = 0) -> SupportPlane | None:
    """Return the plane that the object stands on by the points of all photos together, None where none is found.

    on_object (P,) bool: points that lie on the object; some on the support do no harm.
    """
    chosen = solution.points[on_object]
    if len(chosen) < _FEWEST:
        return None
    near, radius = _around(solution, chosen)
    rng = np.random.default_rng(seed)
    return _fit(solution.points[near], chosen, solution.pose[:, :3, 3], radius, rng)


def _around(solution: Solution, chosen: np.ndarray) -> tuple[np.ndarray, float]:
    """Return which points lie around those `chosen` (K, 3), (P,) bool, and the radius of these."""
    center = np.median(chosen, axis=0)
    radius = float(np.quantile(np.linalg.norm(chosen - center, axis=1), 0.9))
    return np.linalg.norm(solution.points - center, axis=1) < _NEAR * radius, radius


def _fit(
    points: np.ndarray, on_object: np.ndarray, eyes: np.ndarray, radius: float, rng: np.random.Generator
) -> SupportPlane | None:
    """Return the plane that most `points` (K, 3) lie on, with object and cameras above it."""
    if len(points) < _FEWEST:
        return None
    thin, best, most = _THIN * radius, None, 0.0
    for _ in range(_TRIALS):
        plane = _through(points[rng.choice(len(points), 3, replace=False)], eyes)
        if plane is None:
            continue
        off = np.abs(plane.height(points))
        score = np.maximum(1 - (off / thin) ** 2, 0).sum()  # MSAC: nearer points count more
        if score > most and _beneath(plane, on_object, eyes, radius):
            best, most = plane, score
    if best is None:
        return None
    for _ in range(5):
        inliers = points[np.abs(best.height(points)) < thin]
        if len(inliers) < _FEWEST:
            return None
        middle = inliers.mean(axis=0)
        normal = np.linalg.svd(inliers - middle, full_matrices=False)[2][2]
        normal = normal if normal @ best.normal > 0 else -normal
        best = SupportPlane(normal, float(normal @ middle))
    return best


def _through(three: np.ndarray, eyes: np.ndarray) -> SupportPlane | None:
    normal = np.cross(three[1] - three[0], three[2] - three[0])
    length = float(np.linalg.norm(normal))
    if length < 1e-12:
        return None
    plane = SupportPlane(normal / length, float(normal @ three[0] / length))
    up = np.median(plane.height(eyes)) > 0
    return plane if up else SupportPlane(-plane.normal, -plane.offset)


def _beneath(plane: SupportPlane, on_object: np.ndarray, eyes: np.ndarray, radius: float) -> bool:
    heights = plane.height(on_object)
    return bool(
        (heights < -2 * _THIN * radius).mean() <= _BELOW
        and (plane.height(eyes) < 0).mean() <= _BELOW
        and np.quantile(heights, _BELOW) < _UNDER * radius
        and np.quantile(heights, 0.9) > _UNDER * radius  # not a face that the object's points lie on
    )


@dataclass(frozen=True)
class PlaneChart:
    """Coordinates on a plane: cell (row, column) shows origin + column across + row along."""

    origin: np.ndarray  # (3,)
    across: np.ndarray  # (3,)
    along: np.ndarray  # (3,)

    @staticmethod
    def around(plane: SupportPlane, center: np.ndarray, reach: float, cells: int) -> "PlaneChart":
        """Return the chart of so many `cells` along an edge that reaches so far around a point (3,)."""
        across = np.cross(plane.normal, np.eye(3)[np.abs(plane.normal).argmin()])
        across /= np.linalg.norm(across)
        along = np.cross(plane.normal, across)
        cell = 2 * reach / cells
        foot = center - plane.height(center) * plane.normal
        return PlaneChart(foot - reach * (across + along), cell * across, cell * along)

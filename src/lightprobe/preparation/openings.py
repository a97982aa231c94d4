"""Openings that the hull closes: places deep inside its outline where a photo sees what lies behind the object.

Masks that close an opening have a hull that is solid there, and a cut around the hull would take what is deep inside
it for the object. Two things together tell otherwise: points that the photo, or one from nearly the same place, saw
although much of the hull lies before them, and that lie behind the hull; and the colours around them, which are those
of the surroundings and not those of the object's points.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from lightprobe.preparation.masks import DOT, SHARP_POINT, Cutout, View, photos_from_near, rim, seen_by, silhouette_of
from lightprobe.preparation.solution import Solution
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.hull import Hull

_THICK = 0.25  # of the object's size: so much of the hull lies before a point that is seen through an opening
_THIN = 0.1  # of the object's size: so little at most lies before a point on the side that the photo sees
_BEHIND = 2.0  # voxels off the hull from which a point does not belong to the object
_OTHERS = 3  # photos from nearly the same place whose points are looked at, too
_FEWEST = 3  # points seen through an opening
_OBJECT_PIXELS = 100  # around points of the object, from which its colours are known
_BINS = 24  # of each channel, in histograms of colours
_UNLIKELY = 1e-6  # share of a colour that a histogram does not hold
_LIKELIER = 1.5  # logarithm of how much likelier a colour is among the surroundings'
_STEPS = 256  # along a ray


@dataclass(frozen=True)
class Sights:
    """Where a photo shows points, (K, 2) pixels each."""

    behind: np.ndarray  # what lies behind the hull, and much of the hull before it
    front: np.ndarray  # the side of the object that the photo sees


def openings(solution: Solution, views: Mapping[int, View], labels: np.ndarray, cutout: Cutout, margin: float
             ) -> dict[int, np.ndarray]:  # fmt: skip
    """Return where photos seem to look through the hull of `cutout`, (h, w) bool, for those that do.

    labels (P,): of the points, as from `masks.object_points`. margin: as in `masks.cut_near_hull`.
    """
    if cutout.hull is None or cutout.similarity is None:
        return {}
    far = _distance(cutout.hull, cutout.similarity.apply(solution.points)) > _BEHIND
    found = {}
    for photo, view in views.items():
        sights = _sights(solution, labels, far, photo, view.camera, cutout.hull, cutout.similarity)
        if len(sights.behind) < _FEWEST:
            continue
        opening = opening_around(view.color, silhouette_of(cutout, view), sights, margin)
        if opening.any():
            found[photo] = opening
    return found


def _sights(solution: Solution, labels: np.ndarray, far: np.ndarray, photo: int, camera: Camera, hull: Hull,
            similarity: Similarity) -> Sights:  # fmt: skip
    sharp, size = solution.errors <= SHARP_POINT, float(hull.occupancy.sum() ** (1 / 3) * hull.voxel.mean())
    near = photos_from_near(solution, photo, solution.points[labels == 1], _OTHERS)

    def shown(chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = solution.points[sharp & chosen]
        x, y, depth = camera.project(points).T
        framed = (depth > 0) & (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
        before = _hull_before(hull, camera.normalised(similarity).position, similarity.apply(points[framed]))
        return np.stack([x, y], 1)[framed], before / size

    behind, thickness = shown(seen_by(solution, near) & far)
    front, thinness = shown(seen_by(solution, [photo]) & (labels == 1))
    return Sights(behind[thickness > _THICK], front[thinness < _THIN])


def _hull_before(hull: Hull, eye: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return how much of the way from `eye` (3,) to each of the `points` (K, 3) lies in the hull, (K,)."""
    away = points - eye
    places = eye + away[:, None] * np.linspace(0, 1, _STEPS)[:, None]
    inside, voxel = _voxels(hull, places)
    solid = np.zeros(inside.shape, bool)
    solid[inside] = hull.occupancy[tuple(voxel[inside].T)]
    return solid.mean(1) * np.linalg.norm(away, axis=1)


def _distance(hull: Hull, points: np.ndarray) -> np.ndarray:
    """Return how far from the hull each of the `points` (P, 3) lies, (P,) voxels; infinite beyond the hull's grid."""
    distance = np.full(len(points), np.inf)
    inside, voxel = _voxels(hull, points)
    distance[inside] = scipy.ndimage.distance_transform_edt(~hull.occupancy)[tuple(voxel[inside].T)]
    return distance


def _voxels(hull: Hull, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which points (..., 3) lie in the hull's grid, (...) bool, and in which voxel, (..., 3)."""
    voxel = np.floor((points - hull.lo) / hull.voxel).astype(int)
    return ((voxel >= 0) & (voxel < hull.occupancy.shape)).all(-1), voxel


def opening_around(color: np.ndarray, shape: np.ndarray, sights: Sights, margin: float) -> np.ndarray:
    """Return the pieces (h, w) bool of the hull's `shape` (h, w) like the surroundings that show points behind it.

    color (h, w, 3) uint8: the photo. margin: of the object's size, beyond which the surroundings begin.
    """
    dot = max(1.0, DOT * max(shape.shape))
    known = shape & (_away_from(sights.front, shape) < dot)
    around = scipy.ndimage.distance_transform_edt(~shape) > rim(shape, margin)
    if known.sum() < _OBJECT_PIXELS or not around.any():
        return np.zeros(shape.shape, bool)
    strange = scipy.ndimage.gaussian_filter(_likelier_around(color, known, around), 1.0) > _LIKELIER
    pieces, _ = scipy.ndimage.label(scipy.ndimage.binary_opening(strange & shape))
    marked = np.unique(pieces[_away_from(sights.behind, shape) < dot])
    return np.isin(pieces, marked[marked > 0])


def _away_from(places: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Return how far from each pixel of `shape` (h, w) the nearest of the `places` (K, 2) is, (h, w)."""
    free = np.ones(shape.shape, bool)
    free[places[:, 1].astype(int), places[:, 0].astype(int)] = False
    return np.full(shape.shape, np.inf) if free.all() else scipy.ndimage.distance_transform_edt(free)


def _likelier_around(color: np.ndarray, known: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Return how much likelier each pixel's colour is `around` the object than where it is `known`, (h, w), as ln."""
    red, green, blue = np.moveaxis(color.astype(int) * _BINS // 256, -1, 0)
    kind = (red * _BINS + green) * _BINS + blue
    logarithms = []
    for chosen in (around, known):
        counts = np.bincount(kind[chosen], minlength=_BINS**3).astype(float).reshape(_BINS, _BINS, _BINS)
        share = scipy.ndimage.gaussian_filter(counts, 1.0, mode="nearest") / chosen.sum()
        logarithms.append(np.log(share.ravel() + _UNLIKELY))
    return (logarithms[0] - logarithms[1])[kind]

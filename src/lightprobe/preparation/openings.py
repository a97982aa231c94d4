"""Openings that the hull closes: places deep inside its outline where a photo sees what lies behind the
object.

Masks that close an opening have a hull that is solid there, and a cut around the hull would take what is deep
inside it for the object. Two things together tell otherwise: points behind the hull that the photo, or one
from nearly the same place, saw although much of the hull lies before them; and the colours around them, which
are those of the background and not those of the object's points.
"""

from collections.abc import Mapping

import numpy as np
import scipy

from lightprobe.preparation import masks
from lightprobe.preparation.mapping import Solution
from lightprobe.preparation.masks import Cutout, View, away_from, dot_radius, in_frame, seen_by
from lightprobe.preparation.near_hull import rim
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.hull import Hull

_THICK = 0.25  # of the object's size: so much of the hull lies before a point that is seen through an opening
_THIN = 0.1  # of the object's size: so little at most lies before a point on the side that the photo sees
_BEHIND = 2.0  # voxels off the hull from which a point does not belong to the object
_OTHERS = 6  # photos from nearly the same place whose points are looked at, too
_FEWEST = 3  # points seen through an opening
_OBJECT_PIXELS = 100  # around points of the object, from which its colours are known
_BINS = 24  # of each channel, in histograms of colours
_UNLIKELY = 1e-6  # share of a colour that a histogram does not hold
_LIKELIER = 1.5  # logarithm of how much likelier a colour is in the background
_STEPS = 128  # along a ray's way through the hull's grid


def openings(
    solution: Solution,
    views: Mapping[int, View],
    labels: np.ndarray,
    cutout: Cutout,
    shapes: Mapping[int, np.ndarray],
    margin: float,
) -> dict[int, np.ndarray]:
    """Return where photos seem to look through the hull of `cutout`, (h, w) bool, for those that do.

    labels (P,): of the points, as from `masks.object_points`. shapes: the hull's picture (h, w) bool in each
    photo. margin: as in `near_hull.cut_near_hull`.
    """
    if cutout.hull is None or cutout.similarity is None:
        return {}
    depths = _Depths(solution, cutout.hull, cutout.similarity)
    through, found = {photo: depths.through(photo, view.camera) for photo, view in views.items()}, {}
    for photo, view in views.items():
        near = masks.photos_from_near(solution, photo, solution.points[labels == 1], _OTHERS)
        # A point that a neighbour saw beside the object tells nothing here, even behind much of the hull.
        candidates = np.unique(np.concatenate([through[other] for other in near if other in through]))
        behind = depths.within(candidates, view.camera, _THICK, np.inf)
        if len(behind) < _FEWEST:
            continue
        mine = np.flatnonzero(depths.sharp & (labels == 1) & seen_by(solution, [photo]))
        front = depths.within(mine, view.camera, -np.inf, _THIN)
        opening = opening_around(view, shapes[photo], solution.points[behind], solution.points[front], margin)
        if opening.any():
            found[photo] = opening
    return found


class _Depths:
    """How much of the hull lies before points."""

    def __init__(self, solution: Solution, hull: Hull, similarity: Similarity):
        self._solution, self._hull, self._similarity = solution, hull, similarity
        self._points = similarity.apply(solution.points)
        self._size = float(hull.occupancy.sum() ** (1 / 3) * hull.voxel.mean())
        self.sharp = solution.errors <= masks.SHARP_POINT
        self._behind = self.sharp & (_distance(hull, self._points) > _BEHIND)

    def through(self, photo: int, camera: Camera) -> np.ndarray:
        """Return the points (K,) int64 that a photo saw through the hull."""
        behind = np.flatnonzero(self._behind & seen_by(self._solution, [photo]))
        return self.within(behind, camera, _THICK, np.inf)

    def within(self, chosen: np.ndarray, camera: Camera, least: float, most: float) -> np.ndarray:
        """Return which points of `chosen` (K,) in the frame have so much hull before them, (M,) int64.

        least, most: relative to the object's size.
        """
        chosen = chosen[in_frame(camera, self._solution.points[chosen])[0]]
        before = _hull_before(self._hull, camera.normalised(self._similarity).position, self._points[chosen])
        return chosen[(before > least * self._size) & (before < most * self._size)]


def _hull_before(hull: Hull, eye: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return how much of the way from `eye` (3,) to each of the `points` (K, 3) lies in the hull, (K,)."""
    away = points - eye
    with np.errstate(divide="ignore", invalid="ignore"):  # along an axis a ray enters nowhere, or is within
        ends = np.sort(np.stack([(hull.lo - eye) / away, (hull.hi - eye) / away]), axis=0)
    enters, leaves = np.nanmax(ends[0], axis=1).clip(0, 1), np.nanmin(ends[1], axis=1).clip(0, 1)
    solid = np.zeros((_STEPS, len(points)))
    for step, share in enumerate((np.arange(_STEPS) + 0.5) / _STEPS):
        inside, voxel = _voxels(hull, eye + away * (enters + share * (leaves - enters))[:, None])
        solid[step, inside] = hull.occupancy[tuple(voxel[inside].T)]
    return solid.mean(0) * (leaves - enters).clip(0) * np.linalg.norm(away, axis=1)


def _distance(hull: Hull, points: np.ndarray) -> np.ndarray:
    """Return how far from the hull the `points` (P, 3) lie, (P,) voxels; infinite beyond the grid."""
    distance = np.full(len(points), np.inf)
    inside, voxel = _voxels(hull, points)
    distance[inside] = scipy.ndimage.distance_transform_edt(~hull.occupancy)[tuple(voxel[inside].T)]
    return distance


def _voxels(hull: Hull, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which points (..., 3) lie in the hull's grid, (...) bool, and in which voxel, (..., 3)."""
    voxel = np.floor((points - hull.lo) / hull.voxel).astype(int)
    return ((voxel >= 0) & (voxel < hull.occupancy.shape)).all(-1), voxel


def opening_around(
    view: View, shape: np.ndarray, behind: np.ndarray, front: np.ndarray, margin: float
) -> np.ndarray:
    """Return the pieces (h, w) bool of the hull's `shape` (h, w) that look like the background.

    They show points `behind` it. behind, front (K, 3): points seen through the hull, and the object's.
    margin: of the object's size, beyond which the background begins.
    """
    dot = dot_radius(shape.shape)
    known = shape & (away_from(view.camera, front) < dot)
    around = scipy.ndimage.distance_transform_edt(~shape) > rim(shape, margin)
    if known.sum() < _OBJECT_PIXELS or not around.any():
        return np.zeros(shape.shape, bool)
    strange = scipy.ndimage.gaussian_filter(_likelier_around(view.color, known, around), 1.0) > _LIKELIER
    pieces, _ = scipy.ndimage.label(scipy.ndimage.binary_opening(strange & shape))
    marked = np.unique(pieces[away_from(view.camera, behind) < dot])
    return np.isin(pieces, marked[marked > 0])


def _likelier_around(color: np.ndarray, known: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Return ln of how much likelier colours are `around` the object than where it is `known`, (h, w)."""
    red, green, blue = np.moveaxis(color.astype(int) * _BINS // 256, -1, 0)
    kind = (red * _BINS + green) * _BINS + blue
    logarithms = []
    for chosen in (around, known):
        counts = np.bincount(kind[chosen], minlength=_BINS**3).astype(float).reshape(_BINS, _BINS, _BINS)
        share = scipy.ndimage.gaussian_filter(counts, 1.0, mode="nearest") / chosen.sum()
        logarithms.append(np.log(share.ravel() + _UNLIKELY))
    return (logarithms[0] - logarithms[1])[kind]

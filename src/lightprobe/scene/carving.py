"""A visual hull that few photos may carve, where nothing speaks for what they cut away.

A share of masks that must agree can only be strict or lenient everywhere. Masks err, so that a strict one
cuts off what should stay; but an arch or an opening that few photos look through is background in these
alone, and a lenient one fills it. What tells them apart is what is missing afterwards: without a piece that
belongs to the object some masks have holes that nothing else fills, while behind a filled opening lies more
of the object for all who do not look through it. So the strict hull is carved first, and gets back those
voxels of a lenient one that more masks lack. It also gets back what shows beside the object in no photo: only
the pixels of a mask had cut it off.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from lightprobe.imaging import shrink_area
from lightprobe.scene.camera import Camera
from lightprobe.scene.hull import Hull, usual_agreement, visual_hull

_STRICT, _LENIENT = 0.98, 0.9  # shares of masks that must agree
_SIDE = 160  # pixels along the longer side of the masks that are compared
_MARGIN = 1.0  # pixels by which silhouettes of voxels and masks may differ
_FOR = 7.0  # masks that must lack a voxel, for each photo that has it beside the object
_ROUNDS = 2  # what is put back fills holes that other voxels then need not


@dataclass(frozen=True)
class _View:
    """A small mask."""

    camera: Camera
    inside: np.ndarray  # (H, W) bool, the object without its margin
    outside: np.ndarray  # (H, W) bool, the background without its margin

    @staticmethod
    def of(camera: Camera, alpha: np.ndarray) -> "_View":
        mask = shrink_area(np.asarray(alpha), _SIDE) >= 0.5
        inside, outside = (scipy.ndimage.distance_transform_edt(part) > _MARGIN for part in (mask, ~mask))
        return _View(camera.resized(mask.shape[1], mask.shape[0]), inside, outside)

    def votes(self, hull: Hull, points: np.ndarray) -> np.ndarray:
        """Return votes (3, K) bool on `points` (K, 3).

        Which fill a hole that `hull` leaves in the mask, which show beside the object where `hull` does not,
        and which show beside it at all.
        """
        x, y, depth = self.camera.project(points).T
        height, width = self.inside.shape
        seen = np.flatnonzero((depth > 0) & (x >= 0) & (y >= 0) & (x < width) & (y < height))
        at = y[seen].astype(int), x[seen].astype(int)
        empty = ~hull.silhouette(self.camera)
        votes = np.zeros((3, len(points)), bool)
        for vote, picture in zip(
            votes, (empty & self.inside, empty & self.outside, self.outside), strict=True
        ):
            vote[seen] = picture[at]
        return votes


def carved_hull(
    cameras: Sequence[Camera],
    alphas: Sequence[np.ndarray],
    resolution: int,
    *,
    lo: Sequence[float] | np.ndarray,
    hi: Sequence[float] | np.ndarray,
) -> Hull:
    """Return the hull on `resolution`^3 voxels of the box lo..hi, in the frame of `cameras`; `alphas` (H, W).

    With so few photos that every mask counts, it is `visual_hull`.
    """
    strict = max(usual_agreement(len(alphas)), min(_STRICT, 1 - 1.5 / len(alphas)))
    hull = visual_hull(cameras, alphas, resolution, lo=lo, hi=hi, agreement=strict)
    if strict <= _LENIENT or len(alphas) < 10:
        return hull
    lenient = visual_hull(cameras, alphas, resolution, lo=lo, hi=hi, agreement=_LENIENT)
    usual = lenient.score >= np.float32(usual_agreement(len(alphas)))
    pairs = zip(cameras, alphas, strict=True)
    views = [_View.of(camera, alpha) for camera, alpha in pairs if (np.asarray(alpha) >= 0.5).any()]
    for _ in range(_ROUNDS):
        cut = lenient.occupancy & ~hull.occupancy
        points = lenient.centers(cut)
        counts = np.zeros((3, len(points)))
        for view in views:
            counts += view.votes(hull, points)
        occupancy = hull.occupancy.copy()
        lacking, beside, wrong = counts
        occupancy[cut] = (lacking > _FOR * beside) | (usual[cut] & (wrong == 0))
        hull = replace(hull, occupancy=occupancy)
    return hull

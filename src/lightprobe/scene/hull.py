"""The visual hull: the part of space that lies inside the masks of the photos that see it.

What lies outside a photo's frame is unknown to that photo, not empty, so close-ups that crop the object do
not cut it. Votes are robust: a voxel is kept when nearly all, not all, of the masks that see it contain it. A
voxel far out in the background of a photo counts against itself several times: masks and cameras err by a few
pixels, but a hole that few photos look through is background in these, and inside the mask of all others.
Grids are indexed [x, y, z]; voxel k of N along an axis has its centre at lo + (k + 0.5) (hi - lo) / N.

A share of masks that must agree can only be strict or lenient everywhere. A strict one cuts off what erring
masks lack; a lenient one fills an opening that few photos look through. What tells them apart is what is
missing afterwards: without a piece that belongs to the object some masks have holes that nothing else fills,
while behind a filled opening lies more of the object for all who do not look through it. So `carved_hull`
carves the strict hull first and puts back those voxels of a lenient one that more masks lack, and those that
show beside the object in no photo: only the pixels of a mask had cut them off.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from lightprobe.imaging import shrink_area
from lightprobe.kernels import cast_voxels, vote_on_voxels
from lightprobe.scene.camera import Camera

_FAR = 0.02  # of a photo's longer side: background this far off the object is beyond the errors of masks
_FAR_VOTES = 3  # against a voxel, by a photo that has it there; fewer where that one photo would decide alone
_STRICT, _LENIENT = 0.98, 0.9  # shares of masks that must agree
_SIDE = 160  # pixels along the longer side of the masks that are compared
_MARGIN = 1.0  # pixels by which silhouettes of voxels and masks may differ
_FOR = 7.0  # masks that must lack a voxel, for each photo that has it beside the object
_ROUNDS = 2  # what is put back fills holes that other voxels then need not


@dataclass(frozen=True)
class Hull:
    """Votes on a grid of N^3 voxels."""

    occupancy: np.ndarray  # (N, N, N) bool
    score: np.ndarray  # (N, N, N) float32: 1 - votes against / photos that see a voxel; 0 where too few do
    lo: np.ndarray  # (3,) float64, lower corner of the grid
    hi: np.ndarray  # (3,) float64, upper corner

    @property
    def voxel(self) -> np.ndarray:
        """Size of a voxel, (3,) float64."""
        return (self.hi - self.lo) / self.occupancy.shape[0]

    def centers(self, chosen: np.ndarray) -> np.ndarray:
        """Return the centres (K, 3) float64 of the voxels where the (N, N, N) bool `chosen` is True."""
        return self.lo + (np.argwhere(chosen) + 0.5) * self.voxel

    def silhouette(self, camera: Camera) -> np.ndarray:
        """Return the (height, width) bool picture of the occupied voxels for a `camera` in their frame."""
        local = (camera.position - self.lo) / self.voxel
        axes = camera.camera_to_world[:3, :3] / self.voxel[:, None]
        intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        return cast_voxels(self._distance, local, axes, intrinsics, camera.height, camera.width)

    @functools.cached_property
    def _distance(self) -> np.ndarray:
        """Chessboard distance to the nearest occupied voxel, (N, N, N) int32; large when there is none."""
        if not self.occupancy.any():
            return np.full(self.occupancy.shape, 2 * self.occupancy.shape[0], np.int32)
        return scipy.ndimage.distance_transform_cdt(~self.occupancy, metric="chessboard").astype(np.int32)


def visual_hull(
    cameras: Sequence[Camera],
    alphas: Sequence[np.ndarray],
    resolution: int,
    *,
    lo: Sequence[float] | np.ndarray = (-1.05, -1.05, -1.05),
    hi: Sequence[float] | np.ndarray = (1.05, 1.05, 1.05),
    agreement: float | None = None,
    seen_by: float = 0.03,
) -> Hull:
    """Vote on `resolution`^3 voxels of the box lo..hi, in the frame of `cameras` (normalised, by default).

    `alphas` (H, W) may be smaller than their cameras' images. A voxel is occupied when at least `seen_by` of
    the photos (and two, where there are two) see it and at least `agreement` of those (by default
    `usual_agreement`) have it inside the mask (alpha >= 0.5), where one that has it far outside counts up to
    `_FAR_VOTES` times.
    """
    needed = usual_agreement(len(alphas)) if agreement is None else agreement
    pairs = zip(cameras, alphas, strict=True)
    sized = [camera.resized(alpha.shape[1], alpha.shape[0]) for camera, alpha in pairs]
    projections = np.stack([projection_matrix(camera) for camera in sized])
    sizes = np.array([alpha.shape for alpha in alphas], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))])
    far_votes = max(1, min(_FAR_VOTES, int((1 - needed) * len(alphas))))
    ballots = np.concatenate([_ballot(np.asarray(alpha) >= 0.5, far_votes).reshape(-1) for alpha in alphas])
    low, high = np.asarray(lo, np.float64), np.asarray(hi, np.float64)
    voxel = (high - low) / resolution
    votes, seen = vote_on_voxels(projections, sizes, starts, ballots, low, voxel, resolution)
    enough = max(min(2, len(sized)), int(np.ceil(seen_by * len(sized))))
    score = np.where(seen >= enough, votes / np.maximum(seen, 1), 0).astype(np.float32)
    return Hull(score >= np.float32(needed), score, low, high)


def _ballot(mask: np.ndarray, far_votes: int) -> np.ndarray:
    """Return what each pixel of a mask (H, W) bool adds to the votes for a voxel, (H, W) int8.

    A photo without the object knows no distance to it and has one vote.
    """
    if not mask.any():
        return np.zeros(mask.shape, np.int8)
    far = scipy.ndimage.distance_transform_edt(~mask) > _FAR * max(mask.shape)
    return np.where(mask, 1, np.where(far, 1 - far_votes, 0)).astype(np.int8)


def usual_agreement(photos: int) -> float:
    """Return the share of masks that must agree: 95 %, or all but one mask where that is less.

    With under ten photos every mask is needed: each cuts away much that no other does.
    """
    return 0.95 if photos < 10 else min(0.95, 1 - 1.5 / photos)


def projection_matrix(camera: Camera) -> np.ndarray:
    """Return the (3, 4) float64 matrix that maps (x, y, z, 1) to depth * (pixel x, pixel y, 1)."""
    right, up, back = camera.camera_to_world[:3, :3].T
    rows = np.stack([camera.fx * right - camera.cx * back, -camera.fy * up - camera.cy * back, -back])
    return np.concatenate([rows, -rows @ camera.position[:, None]], axis=1)


@dataclass(frozen=True)
class _View:
    """A small mask, as (H, W) bool of the object and of the background, both without their margins."""

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

        They tell which points fill a hole that `hull` leaves in the mask, which show beside the object where
        `hull` does not, and which show beside it at all.
        """
        seen, *at, _ = self.camera.framed(points)
        empty = ~hull.silhouette(self.camera)
        votes = np.zeros((3, len(points)), bool)
        pictures = empty & self.inside, empty & self.outside, self.outside
        for vote, picture in zip(votes, pictures, strict=True):
            vote[seen] = picture[*at]
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

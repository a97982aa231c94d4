"""The visual hull: the part of space that lies inside the masks of the photos that see it.

What lies outside a photo's frame is unknown to that photo, not empty, so close-ups that crop the object do not cut it.
Votes are robust: a voxel is kept when nearly all, not all, of the masks that see it contain it. A voxel far out in
the background of a photo counts against itself several times: masks and cameras err by a few pixels, but a hole that
few photos look through is background in these, and inside the mask of all others.
Grids are indexed [x, y, z]; voxel k of N along an axis has its centre at lo + (k + 0.5) (hi - lo) / N.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
import scipy

from lightprobe.core.jit import compiled, threads
from lightprobe.scene.camera import Camera

_FAR = 0.02  # of a photo's longer side: background further than this from the object is beyond the errors of masks
_FAR_VOTES = 3  # against a voxel, by a photo that has it there; fewer where that one photo would decide alone


@dataclass(frozen=True)
class Hull:
    """Votes on a grid of voxels."""

    occupancy: np.ndarray  # (N, N, N) bool
    score: np.ndarray  # (N, N, N) float32 <= 1: 1 - votes against / photos that see a voxel; 0 where too few see it
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
        """Return the (height, width) bool picture of the occupied voxels seen by `camera`, in the frame of the grid."""
        local = (camera.position - self.lo) / self.voxel
        axes = camera.camera_to_world[:3, :3] / self.voxel[:, None]
        intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        threads(camera.height * camera.width * self.occupancy.shape[0])
        return _cast(self._distance, local, axes, intrinsics, camera.height, camera.width)

    @functools.cached_property
    def _distance(self) -> np.ndarray:
        """Chessboard distance to the nearest occupied voxel, (N, N, N) int32; a large number when there is none."""
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
    """Vote on `resolution`^3 voxels of the box lo..hi, given in the frame of `cameras` (normalised, by default).

    `alphas` (H, W) may be smaller than their cameras' images. A voxel is occupied when at least `seen_by` of the photos
    (and two, where there are two) see it and at least `agreement` of those have it inside the mask (alpha >= 0.5),
    where one that has it far outside counts up to `_FAR_VOTES` times; see `usual_agreement` for the default.
    """
    needed = usual_agreement(len(alphas)) if agreement is None else agreement
    sized = [camera.resized(alpha.shape[1], alpha.shape[0]) for camera, alpha in zip(cameras, alphas, strict=True)]
    projections = np.stack([projection_matrix(camera) for camera in sized])
    sizes = np.array([alpha.shape for alpha in alphas], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))])
    far_votes = max(1, min(_FAR_VOTES, int((1 - needed) * len(alphas))))
    ballots = np.concatenate([_ballot(np.asarray(alpha) >= 0.5, far_votes).reshape(-1) for alpha in alphas])
    low, high = np.asarray(lo, np.float64), np.asarray(hi, np.float64)
    threads(len(sized) * resolution**3)
    votes, seen = _vote(projections, sizes, starts, ballots, low, (high - low) / resolution, resolution)
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
    """Return the share of masks that must agree: 95 %, or all but one where that is less, so that one may be wrong.

    With under ten photos every one is needed: each cuts away much that no other does.
    """
    return 0.95 if photos < 10 else min(0.95, 1 - 1.5 / photos)


def projection_matrix(camera: Camera) -> np.ndarray:
    """Return the (3, 4) float64 matrix that maps (x, y, z, 1) to depth * (pixel x, pixel y, 1)."""
    right, up, back = camera.camera_to_world[:3, :3].T
    rows = np.stack([camera.fx * right - camera.cx * back, -camera.fy * up - camera.cy * back, -back])
    return np.concatenate([rows, -rows @ camera.position[:, None]], axis=1)


@compiled(parallel=True)
def _vote(
    projections: np.ndarray,
    sizes: np.ndarray,
    starts: np.ndarray,
    ballots: np.ndarray,
    lo: np.ndarray,
    voxel: np.ndarray,
    resolution: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Sum, per voxel centre, the ballots of the photos that see it, and count these; two (N, N, N) int32."""
    votes = np.zeros((resolution, resolution, resolution), np.int32)
    seen = np.zeros((resolution, resolution, resolution), np.int32)
    for i in numba.prange(resolution):
        x = lo[0] + (i + 0.5) * voxel[0]
        for j in range(resolution):
            y = lo[1] + (j + 0.5) * voxel[1]
            for view in range(len(projections)):
                p = projections[view]
                height, width = sizes[view]
                u0 = p[0, 0] * x + p[0, 1] * y + p[0, 3]
                v0 = p[1, 0] * x + p[1, 1] * y + p[1, 3]
                w0 = p[2, 0] * x + p[2, 1] * y + p[2, 3]
                for k in range(resolution):
                    z = lo[2] + (k + 0.5) * voxel[2]
                    depth = w0 + p[2, 2] * z
                    if not depth > 1e-9:  # written so that NaN fails, here and below
                        continue
                    column, row = (u0 + p[0, 2] * z) / depth, (v0 + p[1, 2] * z) / depth
                    if not (0 <= column < width and 0 <= row < height):
                        continue
                    seen[i, j, k] += 1
                    votes[i, j, k] += ballots[starts[view] + int(row) * width + int(column)]
    return votes, seen


@compiled(parallel=True)
def _cast(
    distance: np.ndarray, origin: np.ndarray, axes: np.ndarray, intrinsics: np.ndarray, height: int, width: int
) -> np.ndarray:
    """March a ray per pixel through the grid; `origin` and `axes` (columns right, up, back) are in voxel units."""
    picture = np.zeros((height, width), np.bool_)
    fx, fy, cx, cy = intrinsics
    for row in numba.prange(height):
        for column in range(width):
            x, y = (column + 0.5 - cx) / fx, -(row + 0.5 - cy) / fy
            dx = axes[0, 0] * x + axes[0, 1] * y - axes[0, 2]
            dy = axes[1, 0] * x + axes[1, 1] * y - axes[1, 2]
            dz = axes[2, 0] * x + axes[2, 1] * y - axes[2, 2]
            picture[row, column] = _hits(distance, origin[0], origin[1], origin[2], dx, dy, dz)
    return picture


@compiled()
def _hits(distance: np.ndarray, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> bool:
    """Tell whether a ray meets an occupied voxel: from voxel to voxel near one, in leaps where all around is empty.

    From so far away that a step is lost in rounding, it may stay where it is; after many times the steps that a ray can
    need it has met nothing.
    """
    size = distance.shape[0]
    longest = max(abs(dx), abs(dy), abs(dz))
    # Tiny components instead of zeros keep every division finite.
    dx, dy, dz = _nonzero(dx), _nonzero(dy), _nonzero(dz)
    enter = max(min(-ox / dx, (size - ox) / dx), min(-oy / dy, (size - oy) / dy), min(-oz / dz, (size - oz) / dz))
    leave = min(max(-ox / dx, (size - ox) / dx), max(-oy / dy, (size - oy) / dy), max(-oz / dz, (size - oz) / dz))
    nudge = 1e-6 / longest  # past the wall of a voxel
    t = max(enter, 0.0) + nudge
    for _ in range(16 * size):
        if not t < leave:
            break
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        i, j, k = min(max(int(x), 0), size - 1), min(max(int(y), 0), size - 1), min(max(int(z), 0), size - 1)
        gap = distance[i, j, k]
        if gap == 0:
            return True
        if gap > 1:
            t += (gap - 1) / longest
        else:
            wall = min((i + (dx > 0) - x) / dx, (j + (dy > 0) - y) / dy, (k + (dz > 0) - z) / dz)
            t += max(wall, 0.0) + nudge
    return False


@compiled()
def _nonzero(value: float) -> float:
    return value if abs(value) > 1e-9 else 1e-9

"""Numba body of the voxels; symbols as in `lightprobe.kernels.voxels`."""

import numpy as np
from numba import prange

from lightprobe.core.jit import compiled, threads


def vote(
    projections: np.ndarray,
    sizes: np.ndarray,
    starts: np.ndarray,
    ballots: np.ndarray,
    lo: np.ndarray,
    voxel: np.ndarray,
    resolution: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the sums of ballots and the numbers of photos, two (N, N, N) int32."""
    threads(len(projections) * resolution**3)
    return _vote(projections, sizes, starts, ballots, lo, voxel, resolution)


def cast(
    distance: np.ndarray,
    origin: np.ndarray,
    axes: np.ndarray,
    intrinsics: np.ndarray,
    height: int,
    width: int,
) -> np.ndarray:
    """Return the picture (height, width) bool, a ray marched per pixel."""
    threads(height * width * distance.shape[0])
    return _cast(distance, origin, axes, intrinsics, height, width)


@compiled(parallel=True)
def _vote(projections, sizes, starts, ballots, lo, voxel, resolution):
    votes = np.zeros((resolution, resolution, resolution), np.int32)
    seen = np.zeros((resolution, resolution, resolution), np.int32)
    for i in prange(resolution):
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
def _cast(distance, origin, axes, intrinsics, height, width):
    picture = np.zeros((height, width), np.bool_)
    fx, fy, cx, cy = intrinsics
    for row in prange(height):
        for column in range(width):
            x, y = (column + 0.5 - cx) / fx, -(row + 0.5 - cy) / fy
            dx = axes[0, 0] * x + axes[0, 1] * y - axes[0, 2]
            dy = axes[1, 0] * x + axes[1, 1] * y - axes[1, 2]
            dz = axes[2, 0] * x + axes[2, 1] * y - axes[2, 2]
            picture[row, column] = _hits(distance, origin[0], origin[1], origin[2], dx, dy, dz)
    return picture


@compiled()
def _hits(distance, ox, oy, oz, dx, dy, dz):
    """Tell whether a ray meets an occupied voxel: from voxel to voxel near one, in leaps where all around is
    empty.

    From so far away that a step is lost in rounding, it may stay where it is; after many times the steps that
    a ray can need it has met nothing.
    """
    size = distance.shape[0]
    longest = max(abs(dx), abs(dy), abs(dz))
    # Tiny components instead of zeros keep every division finite.
    dx, dy, dz = _nonzero(dx), _nonzero(dy), _nonzero(dz)
    enter = max(
        min(-ox / dx, (size - ox) / dx), min(-oy / dy, (size - oy) / dy), min(-oz / dz, (size - oz) / dz)
    )
    leave = min(
        max(-ox / dx, (size - ox) / dx), max(-oy / dy, (size - oy) / dy), max(-oz / dz, (size - oz) / dz)
    )
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
def _nonzero(value):
    return value if abs(value) > 1e-9 else 1e-9

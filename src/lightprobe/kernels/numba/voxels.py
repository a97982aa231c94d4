"""Numba loops of the voxels; symbols as in `lightprobe.kernels.voxels`."""

import numpy as np
from numba import prange

from lightprobe.core.jit import compiled


@compiled(parallel=True)
def vote(projections, sizes, starts, ballots, lo, voxel, resolution):
    """Return the sums of ballots and the numbers of photos, two (N, N, N) int32."""
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
def cast(distance, origin, axes, intrinsics, height, width):
    """Return the picture (height, width) bool, a ray marched per pixel."""
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
    """Tell whether a ray meets an occupied voxel: from voxel to voxel near one, in leaps through empty space.

    From so far away that a step is lost in rounding, the ray stays where it is; the loop's length ends the search.
    """
    size = distance.shape[0]
    longest = max(abs(dx), abs(dy), abs(dz))
    # Tiny components instead of zeros keep every division finite.
    dx, dy, dz = _nonzero(dx), _nonzero(dy), _nonzero(dz)
    x0, x1, y0, y1 = -ox / dx, (size - ox) / dx, -oy / dy, (size - oy) / dy
    z0, z1 = -oz / dz, (size - oz) / dz
    enter = max(min(x0, x1), min(y0, y1), min(z0, z1))
    leave = min(max(x0, x1), max(y0, y1), max(z0, z1))
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

"""Plain body of the voxels; symbols as in `lightprobe.kernels.voxels`."""

import numpy as np


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
    index = np.indices((resolution,) * 3).reshape(3, -1)
    x, y, z = lo[:, None] + (index + 0.5) * voxel[:, None]
    votes, seen = np.zeros(index.shape[1], np.int32), np.zeros(index.shape[1], np.int32)
    for projection, (height, width), start in zip(projections, sizes, starts, strict=False):  # one start more
        u, v, depth = (row[0] * x + row[1] * y + row[3] + row[2] * z for row in projection)
        with np.errstate(divide="ignore", invalid="ignore"):
            column, row = u / depth, v / depth
            inside = (depth > 1e-9) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        seen += inside
        votes[inside] += ballots[start + row[inside].astype(int) * width + column[inside].astype(int)]
    return votes.reshape((resolution,) * 3), seen.reshape((resolution,) * 3)


def cast(
    distance: np.ndarray,
    origin: np.ndarray,
    axes: np.ndarray,
    intrinsics: np.ndarray,
    height: int,
    width: int,
) -> np.ndarray:
    """Return the picture (height, width) bool: every occupied voxel's box against every ray."""
    fx, fy, cx, cy = intrinsics
    row, column = np.mgrid[:height, :width] + 0.5
    rays = np.stack([(column - cx) / fx, -(row - cy) / fy, -np.ones_like(row)], axis=2) @ axes.T
    picture = np.zeros((height, width), bool)
    for low in np.argwhere(distance == 0):
        with np.errstate(divide="ignore", invalid="ignore"):
            near, far = (low - origin) / rays, (low + 1 - origin) / rays
        enter, leave = np.minimum(near, far).max(axis=2), np.maximum(near, far).min(axis=2)
        picture |= (leave > np.maximum(enter, 0)) & (leave - enter > 1e-6)
    return picture

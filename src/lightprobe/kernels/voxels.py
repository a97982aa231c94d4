"""A grid of voxels and the photos around it: how the photos vote on the voxels, and which rays meet one.

    grid (N, N, N), indexed [x, y, z]; voxel k along an axis has its centre at lo + (k + 0.5) voxel
    pixel (row, column) of a photo covers [column, column + 1) x [row, row + 1); row 0 on top

NumPy arrays on the CPU, float64 where they are not integers; not differentiable.
"""

import numpy as np

from lightprobe.kernels import dispatch


def vote_on_voxels(
    projections: np.ndarray,
    sizes: np.ndarray,
    starts: np.ndarray,
    ballots: np.ndarray,
    lo: np.ndarray,
    voxel: np.ndarray,
    resolution: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the sum of the ballots of all photos that see a voxel's centre, and their number: (N, N, N) int32.

    projections (K, 3, 4): (x, y, z, 1) to depth * (column, row, 1) of each of K photos; sizes (K, 2) int64:
    height and width; ballots (pixels of all,) int8: what each pixel adds, where photo k begins at starts[k],
    (K + 1,) int64. lo, voxel (3,) float64: corner of the grid and size of a voxel; resolution N.
    """
    loops = dispatch.compiled_loops("voxels", len(projections) * resolution**3)
    return loops.vote(projections, sizes, starts, ballots, lo, voxel, resolution)


def cast_voxels(
    distance: np.ndarray,
    origin: np.ndarray,
    axes: np.ndarray,
    intrinsics: np.ndarray,
    height: int,
    width: int,
) -> np.ndarray:
    """Return the picture (height, width) bool: whether the ray of a pixel's centre meets an occupied voxel.

    distance (N, N, N) int32: the chessboard distance to the nearest occupied voxel, 0 there. origin (3,) and
    axes (3, 3), columns right, up and back, in units of voxels, the grid being [0, N]^3; intrinsics (4,):
    focal lengths and principal point, x and y, in pixels.
    """
    loops = dispatch.compiled_loops("voxels", height * width * distance.shape[0])
    return loops.cast(distance, origin, axes, intrinsics, height, width)

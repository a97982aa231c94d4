"""Voxels: votes and silhouettes against the plain reference, and on any number of threads."""

import numpy as np
import pytest
import scipy.ndimage

from lightprobe.kernels import cast_voxels, vote_on_voxels
from lightprobe.scene.hull import projection_matrix
from tests.shapes import camera_at
from tests.threads import assert_same_bits

POSITIONS = [(3, 1, 0.5), (0.5, -3, 1), (0.2, 0.1, 4), (0.1, 0.3, 0.05)]  # the last is inside the grid


def photos(seed=0):
    """Return the arguments of the votes of photos of different sizes that add something else in every pixel."""
    random = np.random.default_rng(seed)
    cameras = [camera_at(position, size=30 + 5 * k, width=40) for k, position in enumerate(POSITIONS)]
    sizes = np.array([(camera.height, camera.width) for camera in cameras], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))])
    ballots = random.integers(-2, 2, starts[-1]).astype(np.int8)
    projections = np.stack([projection_matrix(camera) for camera in cameras])
    return projections, sizes, starts, ballots, np.array([-1.0, -0.8, -1.2]), np.array([0.1, 0.08, 0.12]), 20


def rays(position, distance):
    """Return the arguments that cast rays from a camera at `position` in a grid that is the cube [-1, 1]^3."""
    camera, voxel = camera_at(position, size=50, focal=60), 2 / len(distance)
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    return distance, (camera.position + 1) / voxel, camera.camera_to_world[:3, :3] / voxel, intrinsics, 50, 50


def distances(share, seed=0):
    occupied = np.random.default_rng(seed).random((9, 9, 9)) < share
    return scipy.ndimage.distance_transform_cdt(~occupied, metric="chessboard").astype(np.int32)


def plain_votes(projections, sizes, starts, ballots, lo, voxel, resolution):
    index = np.indices((resolution,) * 3).reshape(3, -1)
    x, y, z = lo[:, None] + (index + 0.5) * voxel[:, None]
    votes, seen = np.zeros(index.shape[1], np.int32), np.zeros(index.shape[1], np.int32)
    for projection, (height, width), start in zip(projections, sizes, starts, strict=False):  # one start more
        u, v, depth = (row[0] * x + row[1] * y + row[3] + row[2] * z for row in projection)
        column, row = u / depth, v / depth
        inside = (depth > 1e-9) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        seen += inside
        votes[inside] += ballots[start + row[inside].astype(int) * width + column[inside].astype(int)]
    return votes.reshape((resolution,) * 3), seen.reshape((resolution,) * 3)


def plain_picture(distance, origin, axes, intrinsics, height, width):
    """Every occupied voxel's box against every ray."""
    fx, fy, cx, cy = intrinsics
    row, column = np.mgrid[:height, :width] + 0.5
    rays = np.stack([(column - cx) / fx, -(row - cy) / fy, -np.ones_like(row)], axis=2) @ axes.T
    picture = np.zeros((height, width), bool)
    for low in np.argwhere(distance == 0):
        near, far = (low - origin) / rays, (low + 1 - origin) / rays
        enter, leave = np.minimum(near, far).max(axis=2), np.maximum(near, far).min(axis=2)
        picture |= (leave > np.maximum(enter, 0)) & (leave - enter > 1e-6)
    return picture


def test_votes_match_the_reference():
    votes, seen = vote_on_voxels(*photos())
    for found, expected in zip((votes, seen), plain_votes(*photos()), strict=True):
        assert found.dtype == expected.dtype == np.int32
        assert np.array_equal(found, expected)
    assert votes.min() < 0 < votes.max()
    assert seen.min() < seen.max() == len(POSITIONS)


@pytest.mark.parametrize("share", [0.003, 0.05, 0.9])
def test_silhouettes_match_the_reference(share):
    """But for rays that graze an edge of a voxel."""
    for position in POSITIONS:
        case = rays(position, distances(share))
        expected = plain_picture(*case)
        assert (cast_voxels(*case) != expected).sum() <= 1
        assert expected.any()


def test_bits_do_not_depend_on_threads():
    assert_same_bits(lambda: (*vote_on_voxels(*photos()), cast_voxels(*rays(POSITIONS[0], distances(0.05)))))

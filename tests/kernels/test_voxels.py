"""Voxels: votes and silhouettes against the plain reference, and on any number of threads."""

import numpy as np
import pytest
import scipy.ndimage

from lightprobe.kernels import cast_voxels, dispatch, vote_on_voxels
from lightprobe.scene.hull import projection_matrix
from tests.shapes import camera_at
from tests.threads import torch_threads

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


def test_votes_match_the_reference(monkeypatch):
    votes, seen = vote_on_voxels(*photos())
    monkeypatch.setattr(dispatch, "body_for", lambda device: dispatch.Body.REFERENCE)
    for found, expected in zip((votes, seen), vote_on_voxels(*photos()), strict=True):
        assert found.dtype == expected.dtype == np.int32
        assert np.array_equal(found, expected)
    assert votes.min() < 0 < votes.max()
    assert seen.min() < seen.max() == len(POSITIONS)


@pytest.mark.parametrize("share", [0.003, 0.05, 0.9])
def test_silhouettes_match_the_reference(monkeypatch, share):
    """But for rays that graze an edge of a voxel."""
    found = [cast_voxels(*rays(position, distances(share))) for position in POSITIONS]
    monkeypatch.setattr(dispatch, "body_for", lambda device: dispatch.Body.REFERENCE)
    for picture, position in zip(found, POSITIONS, strict=True):
        expected = cast_voxels(*rays(position, distances(share)))
        assert (picture != expected).sum() <= 1
        assert expected.any()


def test_bits_do_not_depend_on_threads():
    results = []
    for count in (1, 2):
        with torch_threads(count):
            results.append((*vote_on_voxels(*photos()), cast_voxels(*rays(POSITIONS[0], distances(0.05)))))
    for one, two in zip(*results, strict=True):
        assert np.array_equal(one, two)

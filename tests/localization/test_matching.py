"""Poses from matches."""

import numpy as np
import pytest

from lightprobe.localization.features import Features, find_features
from lightprobe.localization.matching import matched_poses
from lightprobe.localization.pose import mean_distance


@pytest.mark.slow
def test_matches_agree_about_the_pose(asset, views, camera, photo):
    features = find_features(photo[0], 400)
    poses = matched_poses(features, views.landmarks, [camera.fx], camera.width, camera.height)
    points = asset.mesh.vertices[::20].double().numpy()
    assert poses[0].inliers >= 12
    assert mean_distance(poses[0].camera, camera, points) < 2
    assert [pose.inliers for pose in poses] == sorted((pose.inliers for pose in poses), reverse=True)


def test_the_right_focal_length_has_the_most_inliers(views, camera, photo):
    features = find_features(photo[0], 400)
    focals = [camera.fx * factor for factor in (0.4, 1.0, 3.0)]
    poses = matched_poses(features, views.landmarks, focals, camera.width, camera.height)
    assert poses[0].camera.fx == focals[1]


@pytest.mark.slow
def test_nothing_agrees_about_noise(views):
    random = np.random.default_rng(0)
    noise = Features(
        random.uniform(0, 128, (200, 2)).astype(np.float32),
        random.integers(0, 60, (200, 128), dtype=np.uint8),
    )
    poses = matched_poses(noise, views.landmarks, [170.0], 128, 128)
    assert all(pose.inliers < 12 for pose in poses)
    nothing = Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8))
    assert matched_poses(nothing, views.landmarks, [170.0], 128, 128) == []

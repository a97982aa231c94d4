"""Poses from matches."""

import sys

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.imaging import read_ldr
from lightprobe.localization.matching import Features, find_features, load_opencv, matched_poses
from lightprobe.localization.pose import mean_distance
from tests.painted_object import SIMILARITY


def test_features_stay_inside_the_mask_and_under_their_number(photo):
    color, cover = photo
    every, some = find_features(color, 400), find_features(color, 20)
    assert len(some.place) == 20 < len(every.place)
    assert np.array_equal(some.descriptor, every.descriptor[:20])
    inside = find_features(color, 400, cover > 0.9)
    x, y = inside.place.astype(int).T
    assert len(inside.place) > 10
    assert (cover[y, x] > 0.9).all()
    assert inside.descriptor.dtype == np.uint8
    assert inside.descriptor.max() > 50


def test_places_are_those_of_the_photo_at_any_size(photo):
    color = photo[0]
    large = np.kron(color, np.ones((7, 7, 1), np.float32))  # is reduced, where the small one is magnified
    places = [find_features(c, 30).place / n for c, n in ((color, len(color)), (large, len(large)))]
    apart = np.linalg.norm(places[0][:, None] - places[1][None], axis=2).min(1)
    assert np.median(apart) < 0.01


def test_a_featureless_photo_has_none():
    assert find_features(np.full((40, 60, 3), 0.4, np.float32), 50).descriptor.shape == (0, 128)


def test_without_opencv_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ConfigError, match=r"pip install 'lightprobe\[photos\]'"):
        load_opencv()


@pytest.mark.slow
def test_landmarks_project_to_their_features(views, scene):
    landmarks = views.landmarks
    assert len(landmarks.side) == len(scene.train)
    assert (landmarks.photo.diff() >= 0).all()
    for index, photo in enumerate(scene.train[:2]):
        own = landmarks.photo == index
        color, alpha = read_ldr(photo.image_path)
        features = find_features(color * (alpha[..., None] > 0), 250, alpha >= 0.9)
        place = photo.camera.normalised(SIMILARITY).project(landmarks.point[own].double().numpy())[:, :2]
        same = (features.descriptor[:, None] == landmarks.descriptor[own].numpy()[None]).all(2)
        feature, landmark = np.nonzero(same)
        assert len(feature) >= 10
        assert np.linalg.norm(features.place[feature] - place[landmark], axis=1).max() < 1.0


@pytest.mark.slow
def test_matches_agree_about_the_pose(asset, views, camera, photo):
    features = find_features(photo[0], 400)
    poses = matched_poses(features, views.landmarks, [camera.fx], camera.width, camera.height)
    points = asset.mesh.vertices[::20].double().numpy()
    inliers = [count for _, count in poses]
    assert inliers[0] >= 12
    assert mean_distance(poses[0][0], camera, points) < 2
    assert inliers == sorted(inliers, reverse=True)


def test_the_right_focal_length_has_the_most_inliers(views, camera, photo):
    features = find_features(photo[0], 400)
    focals = [camera.fx * factor for factor in (0.4, 1.0, 3.0)]
    poses = matched_poses(features, views.landmarks, focals, camera.width, camera.height)
    assert poses[0][0].fx == focals[1]


@pytest.mark.slow
def test_nothing_agrees_about_noise(views):
    random = np.random.default_rng(0)
    places = random.uniform(0, 128, (200, 2)).astype(np.float32)
    noise = Features(places, random.integers(0, 60, (200, 128), dtype=np.uint8))
    poses = matched_poses(noise, views.landmarks, [170.0], 128, 128)
    assert all(inliers < 12 for _, inliers in poses)
    nothing = Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8))
    assert matched_poses(nothing, views.landmarks, [170.0], 128, 128) == []

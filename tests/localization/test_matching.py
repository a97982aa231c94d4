"""Poses from matches."""

import sys

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.imaging import read_ldr
from lightprobe.localization.matching import (
    NO_MATCHES,
    PER_PHOTO,
    Features,
    Matches,
    find_features,
    load_opencv,
    match_landmarks,
    matched_poses,
)
from lightprobe.localization.pose import mean_distance, moved
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
    assert np.allclose(np.linalg.norm(inside.descriptor, axis=1), 1, atol=1e-3)


def test_places_are_those_of_the_photo_at_any_size(photo):
    small = np.repeat(np.repeat(photo[0], 4, axis=0), 4, axis=1)  # is magnified
    large = np.kron(small, np.ones((4, 4, 1), np.float32))  # is reduced
    places = [find_features(c, 30).place / len(c) for c in (small, large)]
    apart = np.linalg.norm(places[0][:, None] - places[1][None], axis=2).min(1)
    assert np.median(apart) < 0.01


def test_a_featureless_photo_has_none():
    assert find_features(np.full((40, 60, 3), 0.4, np.float32), 50).descriptor.shape == (0, 64)


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
        features = find_features(color * (alpha[..., None] > 0), PER_PHOTO, alpha >= 0.9)
        place = photo.camera.normalised(SIMILARITY).project(landmarks.point[own].double().numpy())[:, :2]
        assert own.sum() >= 10
        assert np.isin(landmarks.place[own].numpy(), features.place).all()
        assert np.linalg.norm(landmarks.place[own].numpy() - place, axis=1).max() < 1.0


@pytest.fixture(scope="module")
def matches(views, photo):
    return match_landmarks(find_features(photo[0], 1024), views.landmarks)


@pytest.mark.slow
def test_matches_agree_about_the_pose(asset, views, camera, matches):
    poses = matched_poses(matches, views.landmarks, [camera.fx])
    points = asset.mesh.vertices[::20].double().numpy()
    assert mean_distance(poses[0], camera, points) < 2


@pytest.mark.slow
def test_the_right_focal_length_has_the_most_inliers(views, camera, matches):
    focals = [camera.fx * factor for factor in (0.4, 1.0, 3.0)]
    assert matched_poses(matches, views.landmarks, focals)[0].fx == focals[1]


@pytest.mark.slow
def test_features_pull_to_where_they_lie_and_most_at_the_right_camera(camera, matches):
    here, beside = matches.pull(camera), matches.pull(moved(camera, np.array([0.1, 0, 0, 0, 0, 0, 0])))
    assert here.agreed > 2 * beside.agreed
    assert here.agreed <= 1
    small = matches.pull(camera.resized(camera.width // 2, camera.height // 2))
    assert small.agreed == pytest.approx(here.agreed, rel=1e-6)
    assert np.allclose(small.off, here.off / 2)


def test_one_feature_counts_once_and_only_near_where_a_camera_sees_its_point(camera):
    at = camera.project(np.zeros((1, 3)))[0, :2]
    size = (camera.width, camera.height)
    place = np.stack([at, at, at + np.array([40.0, 0])])
    found = Matches(np.array([0, 0, 1]), place, np.zeros((3, 3)), np.array([0, 1, 1]), size).pull(camera)
    assert found.agreed == pytest.approx(1 / 20)  # of so few features that agree fully
    assert np.allclose(found.off, 0, atol=1e-6)
    assert len(found.off) == 1
    assert NO_MATCHES.pull(camera).agreed == 0


@pytest.mark.slow
def test_nothing_agrees_about_noise(views, camera):
    random = np.random.default_rng(0)
    places = random.uniform(0, 128, (200, 2)).astype(np.float32)
    drawn = random.normal(size=(200, 64)).astype(np.float32)
    noise = Features(places, drawn / np.linalg.norm(drawn, axis=1, keepdims=True), (128, 128))
    assert match_landmarks(noise, views.landmarks).pull(camera).agreed < 0.2
    nothing = Features(np.zeros((0, 2), np.float32), np.zeros((0, 64), np.float32), (128, 128))
    assert matched_poses(match_landmarks(nothing, views.landmarks), views.landmarks, [170.0]) == []

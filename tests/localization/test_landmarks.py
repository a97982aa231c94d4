"""Landmarks lie on the object, where their photos show them."""

import numpy as np
import pytest

from lightprobe.imaging import read_ldr
from lightprobe.localization.features import find_features
from tests.painted_object import SIMILARITY


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

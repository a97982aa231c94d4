"""From a photo to the poses that may be its camera's."""

import dataclasses

import numpy as np
import pytest

from lightprobe.localization import pose_search
from lightprobe.localization.appearance import PhotoPyramid
from lightprobe.localization.matching import Landmarks
from lightprobe.localization.pose import mean_distance, symmetric_turns
from lightprobe.localization.pose_search import PoseFinder
from lightprobe.localization.refinement import refine
from lightprobe.localization.verdict import GOOD_SCORE


def poses(finder, color, focal):
    pyramid = PhotoPyramid(color)
    return finder.find(pyramid, finder.matches(pyramid), focal)


@pytest.fixture(scope="module")
def points(asset):
    return asset.mesh.vertices[::20].double().numpy()


@pytest.mark.slow
def test_a_photo_is_located_from_its_matches(known, views, camera, photo, points):
    found = poses(PoseFinder(known, views), photo[0], camera.fx)
    assert mean_distance(found[0].camera, camera, points) < 0.5
    assert found[0].fit.score >= GOOD_SCORE
    assert found[0].fit.agreed > 0.1
    assert all(one.fit.score <= found[0].fit.score for one in found)


@pytest.mark.long
def test_and_without_any_match_from_the_light_alone(known, views, camera, photo, points):
    none = views.landmarks
    nothing = (none.descriptor[:0], none.place[:0], none.point[:0], none.photo[:0])
    blind = Landmarks(*nothing, none.side, none.size)
    found = poses(PoseFinder(known, dataclasses.replace(views, landmarks=blind)), photo[0], camera.fx)
    assert mean_distance(found[0].camera, camera, points) < 0.5
    assert found[0].fit.agreed == 0


@pytest.mark.slow
def test_copies_that_fit_much_worse_are_looked_at_and_not_refined(known, views, camera, photo, monkeypatch):
    asked = []

    def noted(*arguments, **options):
        asked.append(options["steps"])
        return refine(*arguments, **options)

    monkeypatch.setattr(pose_search, "refine", noted)
    poses(PoseFinder(known, views), photo[0], camera.fx)
    turns = len(symmetric_turns(known.mesh))
    assert turns > 0
    assert asked.count(0) == turns + 1  # the pose itself is looked at as its copies are
    assert asked.count(2) <= turns / 2 + 1


def test_nearly_the_training_photos_focal_length_is_theirs(known, views):
    finder = PoseFinder(known, views)
    assert finder.calibrated(1.04 * views.focal) == views.focal
    assert finder.calibrated(1.2 * views.focal) == 1.2 * views.focal


@pytest.mark.slow
def test_the_focal_length_is_found(known, views, camera, photo, points):
    found = poses(PoseFinder(known, views), photo[0], None)
    assert mean_distance(found[0].camera, camera, points) < 0.7
    assert found[0].camera.fx == pytest.approx(camera.fx, rel=0.15)


@pytest.mark.long
def test_noise_is_never_good(known, views):
    random = np.random.default_rng(0)
    noise = np.kron(random.uniform(size=(16, 16, 3)), np.ones((8, 8, 1)))
    found = poses(PoseFinder(known, views), noise.astype(np.float32), 170.0)
    assert not found or found[0].fit.score < GOOD_SCORE

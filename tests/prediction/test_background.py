"""The background of a photo: which directions it shows, and what a map makes of it."""

import numpy as np
import pytest
import torch

from lightprobe.evaluation.metrics import environment_log_rmse, log_difference
from lightprobe.light import cubemap
from lightprobe.models import Decomposition
from lightprobe.models.calibration import Calibration
from lightprobe.prediction import Method, PredictConfig, Predictor
from lightprobe.prediction.background import BackgroundUse, with_background
from lightprobe.prediction.confidence import confidence
from lightprobe.prediction.observation import observe
from lightprobe.render.seen_light import SeenLight
from lightprobe.scene.background import Background
from lightprobe.scene.camera import Similarity
from tests.backgrounds import CAMERA, LIGHT, around
from tests.lit_sphere import CPU, photograph


@pytest.fixture(scope="module")
def photo(sphere):
    return photograph(sphere, CAMERA, LIGHT)


@pytest.fixture(scope="module")
def observation(sphere, photo):
    return observe(sphere, photo, CAMERA, CPU, 65_536)


@pytest.fixture(scope="module")
def background(photo):
    return around(photo, LIGHT)


def rmse(light):
    return environment_log_rmse(log_difference(light, LIGHT))


@pytest.mark.parametrize("factor", [0.5, 1.6])
def test_a_map_of_wrong_brightness_follows_the_background(observation, background, factor):
    """More than where it is seen, which alone takes a tenth off the error, but not everywhere."""
    wrong = factor * LIGHT
    trust = confidence(observation, wrong, fitted=True, seed=0)
    seen = SeenLight.of(background, 16, CPU)
    light, after, use = with_background(observation, wrong, trust, seen, 0)
    assert use is BackgroundUse.USED
    assert rmse(light) < 0.85 * rmse(wrong)
    only = torch.lerp(wrong, seen.radiance, seen.share[..., None])
    assert rmse(only) > 0.88 * rmse(wrong)
    whole = seen.share > 0.9
    torch.testing.assert_close(light[whole], LIGHT[whole], rtol=0.08, atol=0.02)
    assert float(after[whole].min()) > 0.85
    behind = cubemap.directions(16) @ torch.tensor(CAMERA.position).float() > 2.5  # the camera
    assert float((after / trust)[behind].max()) < 1.1
    assert bool((after >= trust * 0.999).all())


def test_a_true_background_leaves_a_true_map(observation, background):
    trust = confidence(observation, LIGHT, fitted=True, seed=0)
    light, _, use = with_background(observation, LIGHT, trust, SeenLight.of(background, 16, CPU), 0)
    assert use is BackgroundUse.USED
    assert rmse(light) < 0.05


def test_clipped_directions_are_lower_bounds(observation, photo):
    trust = confidence(observation, LIGHT, fitted=True, seed=0)
    seen = SeenLight.of(around(photo, LIGHT, white=0.2), 16, CPU)
    light, _, _ = with_background(observation, LIGHT, trust, seen, 0)
    assert rmse(light) < 0.05
    dark, _, use = with_background(observation, 0.4 * LIGHT, trust, seen, 0)
    assert use is BackgroundUse.USED
    whole = (seen.share > 0.9)[..., None] & seen.clipped
    assert float((dark - 0.19)[whole].min()) > -0.02


def test_what_the_object_contradicts_is_left_out(observation, photo):
    trust = confidence(observation, LIGHT, fitted=True, seed=0)
    seen = SeenLight.of(around(photo, 200 * LIGHT), 16, CPU)
    light, after, use = with_background(observation, LIGHT, trust, seen, 0)
    assert use is BackgroundUse.CONTRADICTED
    assert torch.equal(light, LIGHT)
    assert torch.equal(after, trust)


def test_nothing_seen_changes_nothing(observation, background):
    trust = confidence(observation, LIGHT, fitted=True, seed=0)
    none = SeenLight.of(
        Background(background.color, background.seen & False, background.clipped, CAMERA), 16, CPU
    )
    light, _, use = with_background(observation, LIGHT, trust, none, 0)
    assert use is BackgroundUse.ABSENT
    assert torch.equal(light, LIGHT)


@pytest.mark.slow
def test_predictions_follow_it_where_they_are_fitted(decomposition, photo, background):
    predictor = Predictor(decomposition, config=PredictConfig(light_resolution=16))
    plain, with_it = (
        predictor.predict(photo, CAMERA, Method.SOLVE, background=part) for part in (None, background)
    )
    assert (plain.background, with_it.background) == (BackgroundUse.ABSENT, BackgroundUse.USED)
    assert rmse(with_it.environment.texels) < 0.97 * rmse(plain.environment.texels)
    grey = predictor.predict(photo, CAMERA, Method.CONSTANT, background=background)
    assert grey.background is BackgroundUse.ABSENT
    views = [(photo, CAMERA)] * 2
    both, _ = predictor.predict_together(views, Method.SOLVE, backgrounds=[background] * 2)
    assert both.background is BackgroundUse.USED


def test_what_is_seen_is_radiance_whatever_the_object_s_calibration(sphere, photo, background):
    """The object is taken for 1.6 times too bright, and its lights for as much too dim, until they are
    calibrated.
    """
    known = Decomposition(
        sphere, {}, Similarity(np.zeros(3), 1.0), calibration=Calibration((1.6, 1.6, 1.6), "a card")
    )
    dim = photograph(sphere, CAMERA, LIGHT / 1.6)
    found = Predictor(known, config=PredictConfig(light_resolution=16)).predict(
        dim, CAMERA, Method.SOLVE, background=background
    )
    assert found.background is BackgroundUse.USED
    whole = SeenLight.of(background, 16, CPU).share > 0.9
    torch.testing.assert_close(found.environment.texels[whole], LIGHT[whole], rtol=0.03, atol=0.01)

"""Photos of an object under lights that are known, and what predictions for them come to."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.config import DistillConfig
from lightprobe.evaluation.simulated_photos import directional_error, light_accuracy, simulated_photos
from lightprobe.light.cubemap import directions
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition, ObjectVerdict, ProbeModel
from lightprobe.models.probe_model import new_network, new_sphere
from lightprobe.prediction import Method, PredictConfig, Predictor
from lightprobe.scene.camera import Similarity
from tests.lit_sphere import glossy_sphere
from tests.shapes import camera_at

CPU = torch.device("cpu")
CAMERAS = [camera_at((2.6, 1.4, 1.2), size=32, focal=42.0), camera_at((-2.6, 1.4, 1.2), size=32, focal=42.0)]
AWAY = replace(CAMERAS[0], cx=-60.0)  # sees beside the object
CONFIG = PredictConfig(light_resolution=8)


@pytest.fixture(scope="module")
def sphere():
    return Decomposition(glossy_sphere(), {}, Similarity(np.zeros(3), 1.0))


@pytest.fixture(scope="module")
def model():
    config = replace(DistillConfig(), light_resolution=8, width=16, depth=2, sphere_width=4)
    light, up = Environment(torch.ones(6, 8, 8, 3)), torch.tensor([0.0, 0.0, 1.0])
    return ProbeModel(new_network(config), light, up, config, new_sphere(config))


def test_photos_are_eight_bits_of_the_object_in_the_light_they_come_with(sphere):
    first, second = simulated_photos(sphere, CAMERAS, 2, 16, CPU)
    assert (first.camera.camera_to_world != second.camera.camera_to_world).any()
    inside = first.pixels.alpha > 0
    assert 0.1 < inside.mean() < 0.9
    assert 0.02 < first.pixels.color[inside].mean() <= 1
    assert len(np.unique(first.pixels.color)) <= 256
    assert float(directional_error(first.light, second.light).mean()) > 0.2  # other photos, other lights
    again = next(iter(simulated_photos(sphere, CAMERAS, 2, 16, CPU)))
    assert np.array_equal(again.pixels.color, first.pixels.color)
    assert torch.equal(again.light, first.light)


def test_lights_come_from_the_same_side_of_every_camera(sphere):
    """From a camera that stands elsewhere a ball looks the same: the light is turned with the camera."""
    one, other = (torch.from_numpy(camera.camera_to_world[:3, :3]).float() for camera in CAMERAS)
    seen = [[photo.light for photo in simulated_photos(sphere, [camera], 8, 16, CPU)] for camera in CAMERAS]
    in_view, in_scene = [], []
    for lights in zip(*seen, strict=True):
        flows = [(light.mean(-1, keepdim=True) * directions(16)).sum((0, 1, 2)) for light in lights]
        first, second = (torch.nn.functional.normalize(flow, dim=0) for flow in flows)  # exposures differ
        in_view.append(float((one.T @ first - other.T @ second).norm()))
        in_scene.append(float((first - second).norm()))
    assert max(in_view) < 0.2  # a small lamp lies in other texels
    assert np.mean(in_view) < 0.2 * np.mean(in_scene)


def test_the_light_of_a_photo_explains_it(sphere):
    """Maps solved from photos without regard to their lights are nearer to these than to other photos'
    lights.
    """
    predictor = Predictor(sphere, config=replace(CONFIG, light_resolution=16))
    photos = list(simulated_photos(sphere, CAMERAS, 4, 16, CPU))
    found = [
        predictor.predict(photo.pixels, photo.camera, Method.SOLVE, refuse=False).environment.texels
        for photo in photos
    ]
    errors = torch.tensor(
        [[float(directional_error(map_, photo.light).mean()) for photo in photos] for map_ in found]
    )
    others = (errors.sum() - errors.trace()) / 12
    assert float(errors.trace() / 4) < 0.8 * float(others), errors


def test_large_cameras_are_reduced_and_views_without_the_object_left_out(sphere):
    large = CAMERAS[0].resized(640, 640)
    photo, nothing = simulated_photos(sphere, [large, AWAY], 2, 8, CPU)
    assert nothing is None
    assert photo.pixels.color.shape == (320, 320, 3)
    assert (photo.camera.width, photo.camera.fx) == (320, 420.0)


def test_the_error_is_of_what_one_factor_cannot_mend():
    light = torch.rand(6, 8, 8, 3, generator=torch.Generator().manual_seed(0)) + 0.5
    assert float(directional_error(3 * light, light).max()) < 1e-2
    assert float(directional_error(light.flip(0), light).mean()) > 0.1


@pytest.mark.slow
def test_scales_bring_the_expected_error_to_the_true_one(sphere, model):
    told = []
    judged = replace(sphere, verdict=ObjectVerdict(0.2, 5))  # whose doubt is the confidence's own business
    found = light_accuracy(judged, model, CAMERAS, CONFIG, CPU, 0, lambda *done: told.append(done), count=3)
    assert found == light_accuracy(sphere, model, CAMERAS, CONFIG, CPU, 0, count=3)
    assert found is not None
    assert told == [(k, 3) for k in range(1, 4)]
    assert found.photos == 3
    assert 0 < found.spheres[0] < found.spheres[2] < 2  # a mirror tells most of a wrong map
    for method, scale in (
        (Method.PROBE_NET_OPTIMIZE, found.fitted_scale),
        (Method.PROBE_NET, found.estimated_scale),
    ):
        predictor = Predictor(sphere, model, config=CONFIG, accuracy=found)
        errors, expected = [], []
        for photo in simulated_photos(sphere, CAMERAS, 3, 8, CPU):
            got = predictor.predict(photo.pixels, photo.camera, method, refuse=False)
            errors.append(directional_error(got.environment.texels, photo.light))
            expected.append(-got.confidence.log() - got.verdict.doubt)
        assert 0.1 < scale < 10
        assert float(torch.stack(expected).mean()) == pytest.approx(
            float(torch.stack(errors).mean()), rel=0.05
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("chosen", "shown"),
    [
        (None, Method.PROBE_MLP_SOLVE),
        (Method.PROBE_MLP, Method.PROBE_MLP),
        (Method.SOLVE, Method.SOLVE),
        (Method.OPTIMIZE, Method.PROBE_MLP_SOLVE),  # would take minutes a photo
    ],
)
def test_what_is_told_is_of_the_runs_own_method(sphere, chosen, shown):
    """Of a model without the sphere network, as the paper's."""
    told, config = [], replace(DistillConfig(), light_resolution=8, width=16, depth=2, sphere_steps=0)
    light, up = Environment(torch.ones(6, 8, 8, 3)), torch.tensor([0.0, 0.0, 1.0])
    model = ProbeModel(new_network(config), light, up, config)
    used = replace(CONFIG, method=chosen)
    found = light_accuracy(
        sphere, model, [*CAMERAS, AWAY], used, CPU, 0, lambda *done: told.append(done), count=3
    )
    assert found is not None
    assert (found.method, found.photos) == (shown, 2)
    assert told == [(1, 3), (2, 3), (3, 3)]  # also where the object is not in the photo


def test_an_object_that_no_camera_sees_has_none(sphere, model):
    assert light_accuracy(sphere, model, [AWAY], CONFIG, CPU, 0, count=2) is None

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.config import OptimizeConfig
from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.errors import ConfigError, ConvergenceError, InputError
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition, ProbeModel
from lightprobe.models.probe_distribution import stack_everywhere
from lightprobe.models.probe_model import new_network, new_sphere
from lightprobe.prediction import Method, PredictConfig, Predictor, methods_for
from lightprobe.prediction.observation import observe
from lightprobe.prediction.prior import desaturated, sampled_probes
from lightprobe.scene.camera import Similarity
from lightprobe.scene.photo import Pixels
from tests.lit_sphere import patch_light, photograph
from tests.shapes import camera_at

CAMERA = camera_at((2.6, 1.4, 1.2), size=64, focal=85.0)
PATCH = (0.2, 1.0, 0.5)
METHODS = list(Method)
COARSE = PredictConfig(light_resolution=16)


@pytest.fixture(scope="module")
def photo(sphere):
    return photograph(sphere, CAMERA, patch_light(PATCH))


@pytest.fixture(scope="module")
def model():
    config = DistillConfig(width=16, depth=1, sphere_width=4)
    network, sphere = new_network(config).requires_grad_(False), new_sphere(config).requires_grad_(False)
    return ProbeModel(
        network, Environment(torch.ones(6, 16, 16, 3)), torch.tensor([0.0, 0.0, 1.0]), config, sphere
    )


@pytest.fixture(scope="module")
def predictor(decomposition, model):
    return Predictor(
        decomposition, model, config=COARSE, optimize_config=OptimizeConfig(iterations=10, pixels=512)
    )


def test_the_configured_method_comes_first(model):
    paper = PredictConfig(method=Method.PROBE_MLP)
    assert methods_for(model, paper)[0] is Method.PROBE_MLP
    assert sorted(methods_for(model, paper)) == sorted(methods_for(model))
    assert methods_for(None, paper)[0] is Method.SOLVE
    network = PredictConfig(method=Method.PROBE_NET_SOLVE)
    assert methods_for(replace(model, sphere=None), network)[0] is Method.PROBE_MLP_SOLVE


@pytest.mark.parametrize("method", [Method.CONSTANT, Method.OPTIMIZE])
def test_a_configured_method_without_a_network_needs_no_model(method):
    assert methods_for(None, PredictConfig(method=method))[0] is method


def test_without_a_fill_in_the_map_is_the_stacked_probes(sphere, model, photo, decomposition):
    filled, plain = (
        Predictor(decomposition, model, config=replace(COARSE, unseen_share=share)) for share in (0.02, 0.0)
    )
    observation = observe(sphere, photo, CAMERA, plain.device, plain.config.max_pixels)
    probes = observation.pixels.take(sampled_probes(observation, 0.25, 0))
    colors = model.network(probes, observation.light_level)
    stacked, _ = stack_everywhere(probes, colors, 16, model.config.alpha_rule)
    assert torch.equal(plain.predict(photo, CAMERA, Method.PROBE_MLP).environment.texels, stacked)
    assert not torch.equal(filled.predict(photo, CAMERA, Method.PROBE_MLP).environment.texels, stacked)


def test_the_share_of_sampled_pixels_is_the_configured_one(sphere, photo):
    observation = observe(sphere, photo, CAMERA, torch.device("cpu"), 65_536)
    count = len(observation.pixels)
    assert [len(sampled_probes(observation, share, 0)) for share in (0.25, 1.0)] == [-(-count // 4), count]


def rerender_error(predictor, photo, light):
    again = photograph(predictor.decomposition.asset, CAMERA, light)
    return float(np.abs(again.color - photo.color)[photo.alpha > 0.5].mean())


def brightest(light):
    """Return the direction of the mean of what exceeds the map's average."""
    luma = light.mean(-1, keepdim=True)
    excess = (luma - 2 * luma.mean()).clamp(min=0) * cubemap.solid_angles(light.shape[1])[..., None]
    return torch.nn.functional.normalize((excess * cubemap.directions(light.shape[1])).sum((0, 1, 2)), dim=0)


@pytest.mark.parametrize("method", METHODS)
def test_maps_are_finite_and_come_with_confidence_and_times(predictor, photo, method):
    prediction = predictor.predict(photo, CAMERA, method)
    assert prediction.environment.texels.shape == (6, 16, 16, 3)
    assert prediction.environment.texels.isfinite().all()
    assert float(prediction.environment.texels.min()) >= 0
    assert prediction.confidence.shape == (6, 16, 16)
    assert 0 <= float(prediction.confidence.min()) < float(prediction.confidence.max()) <= 1
    parts = {"rasterise", "verdict", "network", "stack", "solve", "confidence", "total"}
    assert set(prediction.seconds) == parts
    parts = sum(seconds for part, seconds in prediction.seconds.items() if part != "total")
    assert parts <= prediction.seconds["total"] * 1.001


@pytest.mark.parametrize("method", METHODS)
def test_equal_calls_give_equal_bits(predictor, photo, method):
    first, second = (predictor.predict(photo, CAMERA, method) for _ in range(2))
    assert torch.equal(first.environment.texels, second.environment.texels)
    assert torch.equal(first.confidence, second.confidence)


@pytest.mark.parametrize("method", METHODS)
def test_a_photo_half_as_bright_gives_a_map_half_as_bright(predictor, photo, method):
    dim = Pixels.of(photo.color / photo.color.max() * 0.9, photo.alpha)
    dimmer = Pixels.of(dim.color / 2, photo.alpha)
    full, half = (predictor.predict(p, CAMERA, method).environment.texels for p in (dim, dimmer))
    torch.testing.assert_close(2 * half, full, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    "method", [Method.SOLVE, Method.PROBE_MLP_SOLVE, Method.PROBE_NET_SOLVE, Method.PROBE_NET_OPTIMIZE]
)
def test_a_solved_light_explains_the_photo_and_is_not_mirrored(predictor, photo, method):
    light = predictor.predict(photo, CAMERA, method).environment.texels
    constant = predictor.predict(photo, CAMERA, Method.CONSTANT).environment.texels
    assert rerender_error(predictor, photo, light) < 0.15 * rerender_error(predictor, photo, constant)
    axis = torch.nn.functional.normalize(torch.tensor(PATCH), dim=0)
    assert float(brightest(light) @ axis) > 0.97


@pytest.mark.slow
def test_an_optimisation_reaches_the_solve(sphere, photo, predictor):
    many = OptimizeConfig(iterations=150, pixels=512)
    patient = Predictor(predictor.decomposition, config=COARSE, optimize_config=many)
    optimised, solved = (
        patient.predict(photo, CAMERA, m).environment.texels for m in (Method.OPTIMIZE, Method.SOLVE)
    )
    assert rerender_error(predictor, photo, optimised) < 1.1 * rerender_error(predictor, photo, solved)
    axis = torch.nn.functional.normalize(torch.tensor(PATCH), dim=0)
    assert float(brightest(optimised) @ axis) > 0.97


def test_the_recommended_method_is_the_best_that_the_model_allows(model):
    assert methods_for(model)[0] is Method.PROBE_NET_OPTIMIZE
    assert methods_for(replace(model, sphere=None))[0] is Method.PROBE_MLP_SOLVE
    assert methods_for(None)[0] is Method.SOLVE


def test_an_untrained_network_sees_the_constant_light(predictor, sphere):
    grey = photograph(sphere, CAMERA, torch.full((6, 16, 16, 3), 0.7))
    for method in (Method.CONSTANT, Method.PROBE_MLP, Method.PROBE_NET):
        light = predictor.predict(grey, CAMERA, method).environment.texels
        assert float((light - 0.7).abs().mean()) < (0.01 if method is Method.CONSTANT else 0.2)


def test_unseen_directions_take_the_usual_light(predictor, model, photo):
    """A camera that sees only a corner of the object says nothing about the far side."""
    mask = np.zeros_like(photo.alpha)
    mask[28:36, 28:36] = photo.alpha[28:36, 28:36]
    usual = replace(model, mean_light=Environment(torch.full((6, 16, 16, 3), 3.0)))
    asked = Predictor(predictor.decomposition, usual, config=COARSE)
    prediction = asked.predict(Pixels.of(photo.color, mask), CAMERA, Method.PROBE_MLP)
    camera = -torch.tensor(CAMERA.camera_to_world[:3, 2], dtype=torch.float32)  # behind the object
    behind = (cubemap.directions(16) @ camera) > 0.9
    unseen = prediction.environment.texels[behind] / prediction.environment.texels.mean()
    level = float(photo.color[mask > 0].mean())
    assert float(unseen.min()) > 0.3, f"black where nothing was seen (photo level {level})"


def test_large_photos_are_reduced_without_changing_the_light(sphere, model, decomposition):
    camera = camera_at((2.6, 1.4, 1.2), size=160, focal=212.0)
    photo = photograph(sphere, camera, patch_light(PATCH))
    whole, reduced = (
        Predictor(decomposition, model, config=replace(COARSE, max_pixels=count)).predict(
            photo, camera, Method.PROBE_MLP
        )
        for count in (65_536, 2000)
    )
    difference = (
        whole.environment.texels - reduced.environment.texels
    ).abs().mean() / whole.environment.texels.mean()
    assert float(difference) < 0.1


def test_the_input_frame_is_respected(sphere, model, photo, decomposition):
    """The same photo described in a shifted and scaled frame gives the same light."""
    similarity = Similarity(np.array([3.0, -2.0, 5.0]), 4.0)
    pose = CAMERA.camera_to_world.copy()
    pose[:3, 3] = similarity.invert(pose[:3, 3])
    moved = Predictor(Decomposition(sphere, {}, similarity), model, config=COARSE)
    plain = Predictor(decomposition, model, config=COARSE)
    a = plain.predict(photo, CAMERA, Method.PROBE_MLP).environment.texels
    b = moved.predict(photo, replace(CAMERA, camera_to_world=pose), Method.PROBE_MLP).environment.texels
    torch.testing.assert_close(a, b, rtol=1e-2, atol=1e-2)


def test_what_cannot_be_predicted_is_said_in_one_sentence(predictor, photo, sphere):
    with pytest.raises(InputError, match="64 x 64 pixels but its camera 32 x 32"):
        predictor.predict(photo, CAMERA.resized(32, 32))
    with pytest.raises(InputError, match="Only 0 pixels"):
        predictor.predict(Pixels.of(photo.color, np.zeros_like(photo.alpha)), CAMERA)
    without = Predictor(predictor.decomposition, config=COARSE)
    with pytest.raises(ConfigError, match="no trained model"):
        without.predict(photo, CAMERA, Method.PROBE_MLP)
    paper = Predictor(predictor.decomposition, replace(predictor.model, sphere=None))
    with pytest.raises(ConfigError, match="without the sphere network"):
        paper.predict(photo, CAMERA, Method.PROBE_NET)


@pytest.mark.parametrize("broken", ["network.layers.0.weight", "network.layers.1.bias", "mean_light"])
def test_weights_that_are_no_numbers_are_refused(model, tmp_path, broken):
    model.save(tmp_path)
    path = tmp_path / "illumination_mlp.safetensors"
    tensors = load_tensors(path)
    tensors[broken].view(-1)[0] = math.nan
    save_tensors(path, tensors)
    with pytest.raises(InputError, match=r"illumination_mlp\.safetensors .*NaN.*distill RUN --restart"):
        ProbeModel.load(tmp_path)


def test_a_sphere_network_that_is_no_numbers_or_of_another_size_is_refused(model, tmp_path):
    path, weights = tmp_path / "sphere_net.safetensors", model.sphere.state_dict()
    model.save(tmp_path)
    for changed in ({"out.bias": torch.full((3,), math.nan)}, {"whole.weight": torch.zeros(1)}):
        save_tensors(path, {**weights, **changed})
        with pytest.raises(InputError, match=r"sphere_net\.safetensors .*distill RUN --restart"):
            ProbeModel.load(tmp_path)


def test_weights_too_large_predict_nothing(predictor, photo, model):
    """Finite weights can overflow all the same."""
    weak = Predictor(
        predictor.decomposition, replace(model, mean_light=model.mean_light.scaled(1e38)), config=COARSE
    )
    weak.model = replace(weak.model, mean_light=weak.model.mean_light.scaled(1e38))
    with pytest.raises(ConvergenceError, match="check the photo"):
        weak.predict(photo, CAMERA, Method.PROBE_MLP)


def test_calming_keeps_brightness_and_a_quarter_of_the_hues():
    warm, cold = torch.tensor([2.0, 1.0, 0.5]), torch.tensor([0.5, 1.0, 2.0])
    light = torch.where(torch.arange(16)[None, :, None, None] < 8, warm, cold).expand(6, 16, 16, 3)
    calm = desaturated(light.contiguous(), torch.tensor(1e-6))
    torch.testing.assert_close(calm.log().mean(-1), light.log().mean(-1), rtol=0, atol=1e-4)
    torch.testing.assert_close(
        (calm[..., 0] / calm[..., 2]).log(), 0.25 * (light[..., 0] / light[..., 2]).log(), rtol=0, atol=1e-3
    )


def test_the_mean_hue_and_darkness_stay():
    tinted = torch.tensor([1.3, 1.0, 0.7]).expand(6, 8, 8, 3).clone()
    torch.testing.assert_close(desaturated(tinted, torch.tensor(1.0)), tinted, rtol=1e-4, atol=1e-5)
    assert desaturated(torch.zeros(6, 8, 8, 3), torch.tensor(1.0)).abs().max() < 1e-6

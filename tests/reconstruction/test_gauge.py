"""The brightness that light and base colour share is found again from the photo of a glossy ball."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from lightprobe.reconstruction.gauge import (
    BRIGHTEST,
    CHOICES,
    DARKEST,
    choose_brightness,
    metals_tried,
    trials_at,
)

from lightprobe.core.config import DecomposeConfig, LightUpdate
from lightprobe.light.prefilter import cached
from lightprobe.reconstruction.image_task import ImageTask
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.photos import Target
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import View
from lightprobe.scene.photo import CLIPPED
from lightprobe.training import Stage
from tests.gbuffers import sky, sphere_gbuffer
from tests.shapes import camera_at

CPU = torch.device("cpu")


def ball():
    """Return the G-buffer of a ball, its photo and light, and new lights and configuration to find it with."""
    true = sphere_gbuffer(1500, roughness=0.25, base=(0.3, 0.25, 0.2))
    config = DecomposeConfig()
    operator = cached(config.light_resolution)
    light = 0.5 * sky(config.light_resolution).clamp(max=3)
    photo = shade(true, operator, operator.apply(light))
    target = Target("ball", View.of(camera_at([3, 0, 0.1]), CPU), photo, torch.ones(1500), photo >= CLIPPED)
    lights = Lights(["ball"], config, CPU, 0)
    return true, target, light, lights, config


@pytest.mark.parametrize(("off", "expected"), [(2.0, (0.5, 0.85)), (0.5, (1.2, 2.0)), (1.0, (0.85, 1.2))])
def test_brightness_moves_towards_the_truth(off, expected):
    true, target, light, lights, _ = ball()
    lights.maps = [light / off]  # as it is solved for the wrong surface
    wrong = replace(true, base_color=true.base_color * off)
    factor = choose_brightness([(target, wrong)], lights, 0, mean=0.2)
    assert expected[0] <= factor <= expected[1], factor
    assert np.isclose(factor, choose_brightness([(target, wrong)], lights, 0, mean=0.2))


class _Dark:
    """A model that shows the ball at half its brightness, and remembers how it was brightened."""

    def __init__(self, true, mean):
        self.wrong, self.mean_color = replace(true, base_color=0.5 * true.base_color), torch.tensor(mean)
        self.factors = []

    def gbuffers(self, views, progress):
        return [self.wrong for _ in views]

    def update_visibility(self):
        pass

    def brighten(self, factor):
        self.factors.append(factor)


@pytest.mark.parametrize(("mean", "most"), [(0.2, 2.0), (0.9 * BRIGHTEST, 1 / 0.9)])
def test_no_choice_goes_beyond_the_brightest(mean, most):
    true, target, light, lights, config = ball()
    model = _Dark(true, mean)
    lights.maps = [2 * light]
    ImageTask(model, [target], lights, Stage("pass1", 0, 10), config, 0).refresh(1, 0.1)
    assert model.factors[0] <= most + 1e-6
    assert model.factors[0] >= min(most, 1.2) - 1e-6
    assert torch.allclose(lights.maps[0] * model.factors[0], 2 * light)


def test_no_choice_goes_beyond_the_darkest():
    true, target, light, lights, _ = ball()
    wrong = replace(true, base_color=2 * true.base_color)
    lights.maps = [light / 2]
    assert choose_brightness([(target, wrong)], lights, 0, mean=DARKEST * 1.1) == pytest.approx(1 / 1.1)


def test_lights_on_the_way_by_gradients_follow_the_brightness_too():
    true, target, light, _, config = ball()
    lights = Lights(["ball"], replace(config, light_update=LightUpdate.GRADIENT), CPU, 0)
    lights.load(2 * light[None])
    held, model = lights.maps[0], _Dark(true, 0.2)
    ImageTask(model, [target], lights, Stage("pass1", 0, 10), config, 0).refresh(1, 0.1)
    assert model.factors[0] != 1
    assert lights.maps[0] is held  # as an optimiser holds it
    assert torch.allclose(held * model.factors[0], 2 * light)


@pytest.mark.parametrize(
    ("stage", "iteration", "choices"),
    [
        (Stage("pass1", 0, 2000), 0, 0),
        (Stage("pass1", 0, 2000), 1, 1),
        (Stage("pass1", 0, 2000), CHOICES, 1),
        (Stage("pass1", 0, 2000), CHOICES + 1, 0),
        (Stage("pass2", 100, 100), 1, 0),
    ],
)
def test_only_the_first_checkpoints_choose(stage, iteration, choices):
    true, target, _, lights, config = ball()
    model = _Dark(true, 0.2)
    task = ImageTask(model, [target], lights, stage, replace(config, checkpoint_every=1), 0)
    task.refresh(iteration, 0.1)
    assert len(model.factors) == choices


@pytest.mark.parametrize(
    ("trial_steps", "length", "every", "steps"),
    [
        (240, 1500, 150, {300, 1050}),
        (240, 650, 150, {300, 450}),
        (240, 5000, 1000, {2000, 4000}),
        (240, 301, 150, {150, 300}),
        (0, 1500, 150, set()),
    ],
)
def test_materials_are_tried_on_the_rough_shape_and_again_on_the_nearly_finished_one(
    trial_steps, length, every, steps
):
    config = replace(
        DecomposeConfig(), trial_steps=trial_steps, pass1_iterations=length, checkpoint_every=every
    )
    assert trials_at(config) == steps
    tried = {step for step in range(0, length + 1, every) if metals_tried(config, step)}
    assert tried == ({step for step in range(0, length + 1, every) if step >= max(steps)} if steps else set())


@pytest.mark.parametrize(
    ("length", "only"), [(430, 300), (300, 150)]
)  # after the last step nothing is tried any more
def test_metals_are_not_tried_where_there_is_one_trial(length, only):
    config = replace(DecomposeConfig(), trial_steps=240, pass1_iterations=length, checkpoint_every=150)
    assert trials_at(config) == {only}
    assert not metals_tried(config, length)

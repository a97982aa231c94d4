"""The brightness that light and base colour share is found from the photos of glossy balls."""

import math
from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig, LightUpdate
from lightprobe.light.prefilter import cached
from lightprobe.light.resize import rotate_light
from lightprobe.reconstruction.image_objective import ImageObjective
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.material_field import ScaledMaterial
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.trials import brightness
from lightprobe.reconstruction.trials.brightness import (
    BRIGHTEST,
    DARKEST,
    STARTS,
    best_new,
    best_rescaled,
    choose_brightness,
)
from lightprobe.reconstruction.trials.plausibility import MetalReflectance, light_level
from lightprobe.reconstruction.trials.schedule import CHOICES, metals_tried, trials_at
from lightprobe.reconstruction.trials.trial import Sample, Trial, TrialPhotos
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import View
from lightprobe.scene.photo import CLIPPED
from lightprobe.training import Stage
from tests.gbuffers import R, sky, sphere_gbuffer, turned
from tests.shapes import camera_at

UP = torch.tensor([0.0, 0.0, 1.0])
CPU = torch.device("cpu")
CONFIG = DecomposeConfig(hash_finest=64)
UNFITTED = replace(CONFIG, trial_steps=0)  # trials that change nothing but the brightness


def photos(scale, count=6):
    """Return samples of a glossy ball with bright and dark quarters under turned lights, and grey lights."""
    ball = sphere_gbuffer(1200, roughness=0.25, base=(0.6, 0.6, 0.6))
    dark = (ball.position[:, 1:2] * ball.position[:, 2:3] > 0).float()
    color = scale * ball.base_color * (1 - 0.9 * dark)
    operator, samples = cached(R), []
    for k in range(count):
        light = rotate_light(0.5 * sky(R).clamp(max=3), turned(k), R)
        photo = shade(replace(ball, base_color=color), operator, operator.apply(light))
        photo = photo * 0.22 / photo.mean()
        samples.append(Sample(f"photo{k}", ball, photo, torch.zeros_like(photo, dtype=torch.bool), 0.5, UP))
    return samples, Lights([s.name for s in samples], CONFIG, CPU, 0)


def material_of(mean):
    return ScaledMaterial(mean, UNFITTED, CPU, 0)


def trial_of(samples, lights, steps=0, mean=0.3, factor=1.0):
    return Trial(material_of(mean), TrialPhotos(samples, lights, 0), steps, factor)


@pytest.fixture
def best_at_eight_percent(monkeypatch):
    """Let logarithms of disagreements fall evenly to a mean base colour of .08 and rise from it."""

    def disagreements(trial):
        return torch.full((4, 2), abs(math.log(float(trial.material.mean_color) / 0.08))).double().exp()

    monkeypatch.setattr(Trial, "disagreements", disagreements)


@pytest.mark.parametrize(
    ("mean", "expected"), [(0.5, (0.08, 1.0)), (0.03, (0.08, 1.0)), (0.09, None), (0.07, None)]
)
def test_the_best_start_is_taken_where_it_is_another_one(best_at_eight_percent, mean, expected):
    samples, lights = photos(0.25, 1)
    best = best_new(TrialPhotos(samples, lights, 0), material_of(mean))
    assert (best is None) == (expected is None)
    if best is not None and expected is not None:
        assert float(best[0].material.mean_color) == pytest.approx(expected[0])
        assert best[1] == pytest.approx(expected[1], rel=0.05)


@pytest.mark.parametrize(("mean", "expected"), [(0.16, 0.08), (0.4, 0.1), (0.02, 0.08), (0.08, None)])
def test_the_present_material_is_brightened_or_darkened_and_keeps_what_it_has_learnt(
    best_at_eight_percent, mean, expected
):
    samples, lights = photos(0.25, 1)
    present = material_of(mean)
    points = torch.rand(20, 3)
    before = present(points)
    best = best_rescaled(TrialPhotos(samples, lights, 0), present, settled=True)
    assert torch.equal(present(points), before)
    assert (best is None) == (expected is None)
    if best is not None and expected is not None:
        assert float(best[0].material.mean_color) == pytest.approx(expected)
        assert torch.allclose(best[0].material(points)[:, 3:], before[:, 3:])


@pytest.mark.parametrize(("settled", "changed"), [(True, False), (False, True)])
def test_a_brightness_from_before_the_metals_is_not_defended(monkeypatch, settled, changed):
    """Where a doubled brightness is better by a hundredth."""

    def disagreements(trial):
        doubled = float(trial.material.mean_color) == pytest.approx(0.16)
        return torch.full((4, 2), 1.0 if doubled else 1.01).double()

    monkeypatch.setattr(Trial, "disagreements", disagreements)
    samples, lights = photos(0.25, 1)
    best = best_rescaled(TrialPhotos(samples, lights, 0), material_of(0.08), settled=settled)
    assert (best is not None) == changed
    if best is not None:
        assert float(best[0].material.mean_color) == pytest.approx(0.16)


@pytest.mark.parametrize(("unit", "changed"), [(1.0, False), (5.0, True)])
def test_a_brightness_whose_lights_are_too_unlikely_is_not_defended(monkeypatch, unit, changed):
    """Where parts agree alike at any brightness."""

    def nll(trial):
        return unit * abs(math.log(float(trial.material.mean_color) / 0.08))

    monkeypatch.setattr(Trial, "disagreements", lambda trial: torch.ones(4, 2, dtype=torch.float64))
    monkeypatch.setattr(Trial, "lights_nll", nll)
    samples, lights = photos(0.25, 1)
    best = best_rescaled(TrialPhotos(samples, lights, 0), material_of(0.32), settled=True)
    assert (best is not None) == changed
    if best is not None:
        assert float(best[0].material.mean_color) == pytest.approx(0.08)
    anew = best_new(TrialPhotos(samples, lights, 0), material_of(0.32))
    assert anew is not None
    assert float(anew[0].material.mean_color) == pytest.approx(0.08 if changed else 0.2)  # the usual one


def test_metals_count_once_it_is_known_what_is_metal(monkeypatch):
    def metals(trial):
        return MetalReflectance(0.5, 5 * abs(math.log(float(trial.material.mean_color) / 0.08)))

    monkeypatch.setattr(Trial, "disagreements", lambda trial: torch.ones(4, 2, dtype=torch.float64))
    monkeypatch.setattr(Trial, "metals", metals)
    samples, lights = photos(0.25, 1)
    best = best_rescaled(TrialPhotos(samples, lights, 0), material_of(0.32), settled=True)
    assert best is not None
    assert float(best[0].material.mean_color) == pytest.approx(0.08)
    anew = best_new(TrialPhotos(samples, lights, 0), material_of(0.32))
    assert anew is not None
    assert float(anew[0].material.mean_color) == pytest.approx(0.2)  # the usual one


@pytest.mark.parametrize(
    ("disagreements", "nlls", "best"),
    [
        ([1.0, 1.0, 1.0, 1.0], [0, 0, 0, 0], 1),  # what is usual decides where nothing else does
        ([1.0, 1.01, 1.1, 1.3], [0.5, 0, 0.5, 3], 1),  # or next to nothing
        ([1.0, 1.3, 1.5, 1.9], [0.5, 0, 0.5, 3], 0),  # a bright object whose parts tell
        ([1.9, 1.3, 1.15, 1.0], [0, 0, 0, 0], 3),  # a dark one
        ([1.0, 1.02, 1.08, 1.14], [8.6, 2.7, 0.0, 0.2], 2),  # a dark one whose lights tell
        ([1.02, 1.0, 1.05, 1.15], [0.1, 1.4, 4.1, 6.9], 1),  # lights that tell nothing
        ([1.0, 1.3, 1.5, 1.9], [9.0, 0, 0, 0], 1),
    ],
)
def test_disagreement_lights_and_what_is_usual_decide_together(disagreements, nlls, best):
    spread = 1 + 0.1 * torch.linspace(-1, 1, 8, dtype=torch.float64)[:, None]
    found = [0.03 * value * spread.expand(8, 2) for value in disagreements]
    scores = [brightness._score(errors) for errors in found]
    none = [MetalReflectance(0.0, 0.0)] * len(STARTS)
    assert brightness._most_probable(found, scores, nlls, none, STARTS) == best


@pytest.mark.parametrize(
    ("disagreements", "metals", "share", "best"),
    [
        ([1.0, 1.0, 1.0, 1.0], [0.1, 3.6, 4.0, 4.5], 0.3, 0),  # nothing else tells how bright steel is
        ([1.0, 1.0, 1.0, 1.0], [1.1, 0.6, 3.6, 4.2], 0.6, 1),
        ([1.0, 1.0, 1.0, 1.0], [0.3, 0.3, 0.3, 0.3], 1.0, 0),  # what is usual is so of what is no metal
        ([1.9, 1.3, 1.0, 1.15], [0.1, 0.2, 3.6, 4.2], 0.3, 2),  # a lacquered metal whose parts tell
    ],
)
def test_metals_tell_their_brightness_unless_parts_disagree(disagreements, metals, share, best):
    spread = 1 + 0.1 * torch.linspace(-1, 1, 8, dtype=torch.float64)[:, None]
    found = [0.03 * value * spread.expand(8, 2) for value in disagreements]
    scores = [brightness._score(errors) for errors in found]
    of_trials = [MetalReflectance(share, nll) for nll in metals]
    assert brightness._most_probable(found, scores, [0.0] * 4, of_trials, STARTS) == best


def test_the_disagreement_of_photos_that_both_judge_counts_by_its_uncertainty():
    least = torch.full((8, 2), 0.03, dtype=torch.float64)
    assert brightness._disagreement_nll(least, least) == 0
    spread = torch.linspace(-0.6, 0.6, 8, dtype=torch.float64)[:, None]
    steady, scattered = least * 1.2, least * (1.2 + spread)
    assert (
        brightness._disagreement_nll(steady, least) > 2 * brightness._disagreement_nll(scattered, least) > 0
    )
    unjudged = torch.full((8, 2), torch.nan, dtype=torch.float64)
    assert brightness._disagreement_nll(unjudged, least) == 0
    assert brightness._disagreement_nll(torch.cat([steady[:1], unjudged[1:]]), least) > 0


def test_lights_of_eight_photos_are_judged():
    samples, lights = photos(0.25, 8)
    trial = trial_of(samples, lights)
    assert trial.lights_nll() == pytest.approx(0, abs=1e-6)  # grey all around, as they start
    behind = rotate_light(sky(R), turned(math.pi), R)
    trial.lights = dict.fromkeys(trial.lights, behind)
    assert trial.lights_nll() > 0.2  # though only as much as one photo tells
    assert trial_of(samples[:7], lights).lights_nll() == 0


def test_lights_are_compared_with_what_the_photos_show():
    samples, lights = photos(0.25, 8)
    level = light_level(lights.maps[0])
    bright, usual = ([replace(s, background_level=level + more) for s in samples] for more in (2.0, -0.5))
    assert trial_of(bright, lights).lights_nll() > 5
    assert trial_of(usual, lights).lights_nll() == pytest.approx(0, abs=1e-6)


@pytest.mark.long
def test_the_same_call_gives_the_same_bits():
    samples, lights = photos(0.1, 2)
    trials = [trial_of(samples, lights, steps=6, mean=STARTS[1], factor=0.4) for _ in range(2)]
    assert torch.equal(*(trial.disagreements() for trial in trials))


@pytest.mark.slow
def test_photos_that_cannot_be_halved_have_no_say():
    samples, lights = photos(0.25, 2)
    few = torch.arange(10)
    pixels, color, clipped = (
        part[few] for part in (torch.arange(1200), samples[1].color, samples[1].clipped)
    )
    small = replace(samples[1], pixels=samples[1].pixels.select(pixels), color=color, clipped=clipped)
    errors = trial_of([samples[0], small], lights).disagreements()
    assert errors.isnan().any(1).tolist() == [False, True]
    assert brightness._score(errors) == brightness._score(errors[:1])
    rival = torch.full((3, 2), 0.03, dtype=torch.float64)
    gains = brightness._gains(torch.cat([0.96 * rival[:2], rival[:1] * torch.nan]), rival)
    torch.testing.assert_close(gains, torch.full((2,), 0.04, dtype=torch.float64))


@pytest.mark.parametrize(
    ("errors", "best", "expected"),
    [
        ([3.0, 1.0, 3.0, 5.0], 1, 1.0),  # nearly even on both sides
        ([1.0, 2.0, 3.0, 4.0], 0, 1.0),  # at the end of the range
    ],
)
def test_the_lowest_point_of_the_parabola(errors, best, expected):
    assert brightness._vertex(STARTS, errors, best) == pytest.approx(expected, abs=0.06)


def test_the_lowest_point_leans_towards_the_lower_neighbour():
    assert brightness._vertex(STARTS, [1.5, 1.0, 3.0, 5.0], 1) > 1  # the brighter start is the better one


def test_no_photos_no_trial():
    photos_of_nothing = TrialPhotos([], photos(0.1, 1)[1], 0)
    assert best_new(photos_of_nothing, material_of(0.4)) is None


def ball():
    """Return the G-buffer of a ball, its photo and light, and new lights and configuration to find it with."""
    true = sphere_gbuffer(1500, roughness=0.25, base=(0.3, 0.25, 0.2))
    config = DecomposeConfig()
    operator, light = cached(R), 0.5 * sky(R).clamp(max=3)
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
    assert factor == choose_brightness([(target, wrong)], lights, 0, mean=0.2)


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
    ImageObjective(model, [target], lights, Stage("pass1", 0, 10), config, 0).refresh(1, 0.1)
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
    ImageObjective(model, [target], lights, Stage("pass1", 0, 10), config, 0).refresh(1, 0.1)
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
    task = ImageObjective(model, [target], lights, stage, replace(config, checkpoint_every=1), 0)
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
def test_trials_fall_on_the_rough_shape_and_on_the_nearly_finished_one(trial_steps, length, every, steps):
    config = DecomposeConfig(trial_steps=trial_steps, pass1_iterations=length, checkpoint_every=every)
    assert trials_at(config) == steps
    tried = {step for step in range(0, length + 1, every) if metals_tried(config, step)}
    assert tried == ({step for step in range(0, length + 1, every) if step >= max(steps)} if steps else set())


@pytest.mark.parametrize(("length", "only"), [(430, 300), (300, 150)])  # nothing comes after the last step
def test_metals_are_not_tried_where_there_is_one_trial(length, only):
    config = replace(DecomposeConfig(), trial_steps=240, pass1_iterations=length, checkpoint_every=150)
    assert trials_at(config) == {only}
    assert not metals_tried(config, length)

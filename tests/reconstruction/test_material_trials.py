"""The material fitted from several brightnesses: a dark object that was taken for a bright one is found out."""

import math
from dataclasses import replace

import pytest
import torch
from lightprobe.reconstruction.material_trials import STARTS, Sample, Trial, best_new, best_rescaled
from lightprobe.reconstruction.scaled_material import ScaledMaterial

from lightprobe.core.config import DecomposeConfig
from lightprobe.light.prefilter import cached
from lightprobe.light.resize import rotate_light
from lightprobe.reconstruction import material_trials
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.trials.plausibility import light_level
from lightprobe.render.split_sum import shade
from tests.gbuffers import sky, sphere_gbuffer, turned

UP = torch.tensor([0.0, 0.0, 1.0])
CPU = torch.device("cpu")
CONFIG = DecomposeConfig(hash_finest=64)


def photos(scale, count=6):
    """Return samples of a glossy ball with bright and dark quarters, under turned lights, and lights to start
    from.
    """
    ball = sphere_gbuffer(1200, roughness=0.25, base=(0.6, 0.6, 0.6))
    dark = (ball.position[:, 1:2] * ball.position[:, 2:3] > 0).float()
    color = scale * ball.base_color * (1 - 0.9 * dark)
    operator = cached(CONFIG.light_resolution)
    samples = []
    for k in range(count):
        light = rotate_light(
            0.5 * sky(CONFIG.light_resolution).clamp(max=3), turned(k), CONFIG.light_resolution
        )
        photo = shade(replace(ball, base_color=color), operator, operator.apply(light))
        photo = photo * 0.22 / photo.mean()
        samples.append(Sample(f"photo{k}", ball, photo, torch.zeros_like(photo, dtype=torch.bool), 0.5, UP))
    return samples, Lights([s.name for s in samples], CONFIG, CPU, 0), float(color.mean())


def material_of(mean, config=CONFIG):
    return ScaledMaterial(mean, config, CPU, 0)


@pytest.fixture
def best_at_eight_percent(monkeypatch):
    """Let logarithms of errors fall evenly to a mean base colour of .08 and rise from it, and fits change
    nothing.
    """

    def errors(trial):
        return torch.full(
            (4, 2), abs(math.log(float(trial.material.mean_color) / 0.08)), dtype=torch.float64
        ).exp()

    monkeypatch.setattr(Trial, "fit", lambda trial, steps: None)
    monkeypatch.setattr(Trial, "errors", errors)


@pytest.mark.parametrize(
    ("mean", "expected"), [(0.5, (0.08, 1.0)), (0.03, (0.08, 1.0)), (0.09, None), (0.07, None)]
)
def test_the_best_start_is_taken_where_it_is_another_one(best_at_eight_percent, mean, expected):
    samples, lights, _ = photos(0.25, 1)
    best = best_new(samples, lights, material_of(mean), 0)
    assert (best is None) == (expected is None)
    if best is not None and expected is not None:
        assert float(best[0].material.mean_color) == pytest.approx(expected[0])
        assert best[1] == pytest.approx(expected[1], rel=0.05)


@pytest.mark.parametrize(("mean", "expected"), [(0.16, 0.08), (0.4, 0.1), (0.02, 0.08), (0.08, None)])
def test_the_present_material_is_brightened_or_darkened_and_keeps_what_it_has_learnt(
    best_at_eight_percent, mean, expected
):
    samples, lights, _ = photos(0.25, 1)
    present = material_of(mean)
    points = torch.rand(20, 3)
    before = present(points)
    best = best_rescaled(samples, lights, present, 0, settled=True)
    assert torch.equal(present(points), before)
    assert (best is None) == (expected is None)
    if best is not None and expected is not None:
        assert float(best[0].material.mean_color) == pytest.approx(expected)
        assert torch.allclose(best[0].material(points)[:, 3:], before[:, 3:])


@pytest.mark.parametrize(("settled", "changed"), [(True, False), (False, True)])
def test_a_brightness_from_before_the_metals_is_not_defended(monkeypatch, settled, changed):
    """Where a doubled brightness is better by a hundredth."""

    def errors(trial):
        return torch.full(
            (4, 2), 1.0 if float(trial.material.mean_color) == pytest.approx(0.16) else 1.01
        ).double()

    monkeypatch.setattr(Trial, "fit", lambda trial, steps: None)
    monkeypatch.setattr(Trial, "errors", errors)
    samples, lights, _ = photos(0.25, 1)
    best = best_rescaled(samples, lights, material_of(0.08), 0, settled=settled)
    assert (best is not None) == changed
    if best is not None:
        assert float(best[0].material.mean_color) == pytest.approx(0.16)


@pytest.mark.parametrize(("unit", "changed"), [(1.0, False), (5.0, True)])
def test_a_brightness_whose_lights_are_too_unlikely_is_not_defended(monkeypatch, unit, changed):
    """Where parts agree alike at any brightness."""
    monkeypatch.setattr(Trial, "fit", lambda trial, steps: None)
    monkeypatch.setattr(Trial, "errors", lambda trial: torch.ones(4, 2, dtype=torch.float64))
    monkeypatch.setattr(
        Trial, "surprise", lambda trial: unit * abs(math.log(float(trial.material.mean_color) / 0.08))
    )
    samples, lights, _ = photos(0.25, 1)
    best = best_rescaled(samples, lights, material_of(0.32), 0, settled=True)
    assert (best is not None) == changed
    if best is not None:
        assert float(best[0].material.mean_color) == pytest.approx(0.08)
    anew = best_new(samples, lights, material_of(0.32), 0)
    assert anew is not None
    assert float(anew[0].material.mean_color) == pytest.approx(0.08 if changed else 0.2)  # the usual one


@pytest.mark.parametrize(
    ("disagreements", "surprises", "best"),
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
def test_what_parts_disagree_by_how_likely_lights_are_and_what_is_usual_decide_together(
    disagreements, surprises, best
):
    spread = 1 + 0.1 * torch.linspace(-1, 1, 8, dtype=torch.float64)[:, None]
    found = [0.03 * value * spread.expand(8, 2) for value in disagreements]
    scores = [material_trials._score(errors) for errors in found]
    assert material_trials._likeliest(found, scores, surprises, STARTS) == best


def test_doubt_is_that_of_the_photos_that_both_judge():
    least = torch.full((8, 2), 0.03, dtype=torch.float64)
    assert material_trials._doubt(least, least) == 0
    steady, scattered = (
        least * 1.2,
        least * (1.2 + torch.linspace(-0.6, 0.6, 8, dtype=torch.float64)[:, None]),
    )
    assert material_trials._doubt(steady, least) > 2 * material_trials._doubt(scattered, least) > 0
    unjudged = torch.full((8, 2), torch.nan, dtype=torch.float64)
    assert material_trials._doubt(unjudged, least) == 0
    assert material_trials._doubt(torch.cat([steady[:1], unjudged[1:]]), least) > 0


def test_lights_of_eight_photos_are_judged():
    samples, lights, _ = photos(0.25, 8)
    trial = Trial(material_of(0.3), samples, lights, 1.0, 0)
    assert trial.surprise() == pytest.approx(0, abs=1e-6)  # grey all around, as they start
    behind = rotate_light(sky(CONFIG.light_resolution), turned(math.pi), CONFIG.light_resolution)
    trial.lights = dict.fromkeys(trial.lights, behind)
    assert trial.surprise() > 0.2  # though only as much as one photo tells
    assert Trial(material_of(0.3), samples[:7], lights, 1.0, 0).surprise() == 0


def test_lights_are_compared_with_what_the_photos_show():
    samples, lights, _ = photos(0.25, 8)
    level = light_level(lights.maps[0])
    bright, usual = ([replace(s, shown=level + more) for s in samples] for more in (2.0, -0.5))
    assert Trial(material_of(0.3), bright, lights, 1.0, 0).surprise() > 5
    assert Trial(material_of(0.3), usual, lights, 1.0, 0).surprise() == pytest.approx(0, abs=1e-6)


@pytest.mark.long
def test_the_same_call_gives_the_same_bits():
    samples, lights, _ = photos(0.1, 2)
    errors = []
    for _ in range(2):
        trial = Trial(material_of(STARTS[1]), samples, lights, 0.4, 0)
        trial.fit(6)
        errors.append(trial.errors())
    assert torch.equal(*errors)


@pytest.mark.parametrize(("gain", "spread", "clear"), [(0.02, 0, False), (0.05, 0, True), (0.05, 0.2, False)])
def test_a_nearly_finished_material_is_changed_only_for_what_is_clearly_better(gain, spread, clear):
    rival = torch.full((8, 2), 0.03, dtype=torch.float64)
    by = gain + spread * torch.linspace(-1, 1, 8, dtype=torch.float64)[:, None]
    assert material_trials._clearly_less(rival * (1 - by), rival) is clear


@pytest.mark.slow
def test_photos_that_cannot_be_halved_have_no_say():
    samples, lights, _ = photos(0.25, 2)
    few = torch.arange(10)
    small = replace(
        samples[1],
        pixels=samples[1].pixels.select(few),
        color=samples[1].color[few],
        clipped=samples[1].clipped[few],
    )
    errors = Trial(material_of(0.3), [samples[0], small], lights, 1.0, 0).errors()
    assert errors.isnan().any(1).tolist() == [False, True]
    assert material_trials._score(errors) == material_trials._score(errors[:1])
    rival = torch.tensor([[0.03, 0.03], [0.03, 0.03], [0.03, 0.03]], dtype=torch.float64)
    unjudged = torch.cat([0.96 * rival[:2], rival[:1] * torch.nan])
    assert material_trials._clearly_less(unjudged, rival)  # as a gain of 0 it would make .04 uncertain


@pytest.mark.parametrize(
    ("errors", "best", "expected"),
    [
        ([3.0, 1.0, 3.0, 5.0], 1, 1.0),  # nearly even on both sides
        ([1.0, 2.0, 3.0, 4.0], 0, 1.0),  # at the end of the range
    ],
)
def test_the_lowest_point_of_the_parabola(errors, best, expected):
    assert material_trials._vertex(STARTS, errors, best) == pytest.approx(expected, abs=0.06)


def test_the_lowest_point_leans_towards_the_lower_neighbour():
    assert (
        material_trials._vertex(STARTS, [1.5, 1.0, 3.0, 5.0], 1) > 1
    )  # the brighter start is the better neighbour


def test_no_pixels_no_trial():
    samples, lights, _ = photos(0.1, 1)
    empty = [
        Sample(s.name, s.pixels.select(torch.arange(0)), s.color[:0], s.clipped[:0], 0.0, UP) for s in samples
    ]
    assert best_new(empty, lights, material_of(0.4), 0) is None

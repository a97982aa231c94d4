"""The material fitted anew from several brightnesses: a dark object that was taken for a bright one is found out."""

import math

import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.decompose import material_trials
from lightprobe.decompose.lights import Lights
from lightprobe.decompose.material_trials import STARTS, Sample, best_trial
from lightprobe.light.prefilter import cached
from lightprobe.light.resize import rotate_light
from lightprobe.render.split_sum import shade
from tests.render.test_split_sum import sky, sphere_gbuffer

CPU = torch.device("cpu")
CONFIG = DecomposeConfig(hash_finest=64)


def turned(angle):
    cos, sin = math.cos(angle), math.sin(angle)
    return torch.tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def photos(scale, count=6):
    """Return samples of a glossy ball with bright and dark quarters, under turned lights, and lights to start from."""
    ball = sphere_gbuffer(1200, roughness=0.25, base=(0.6, 0.6, 0.6))
    dark = (ball.position[:, 1:2] * ball.position[:, 2:3] > 0).float()
    color = scale * ball.base_color * (1 - 0.9 * dark)
    operator = cached(CONFIG.light_resolution)
    samples = []
    for k in range(count):
        light = rotate_light(0.5 * sky(CONFIG.light_resolution).clamp(max=3), turned(k), CONFIG.light_resolution)
        true = ball.select(torch.arange(len(ball.pixel)))
        photo = shade(_colored(true, color), operator, operator.apply(light))
        photo = photo * 0.22 / photo.mean()
        samples.append(Sample(f"photo{k}", ball, photo, torch.zeros_like(photo, dtype=torch.bool), 0.5))
    return samples, Lights([s.name for s in samples], CONFIG, CPU, 0), float(color.mean())


def _colored(gbuffer, color):
    from dataclasses import replace

    return replace(gbuffer, base_color=color)


def test_a_dark_object_taken_for_a_bright_one_is_found_out():
    samples, lights, true = photos(0.25)
    best = best_trial(samples, lights, 0.5, CONFIG, 0)
    assert best is not None
    trial, factor = best
    found = float(trial.material.mean_color) * factor
    assert true / 2 < found < 2 * true, (found, true)


def test_a_brightness_that_is_as_good_stays():
    samples, lights, true = photos(1.0)
    assert best_trial(samples, lights, true, CONFIG, 0) is None or abs(math.log(true / 0.33)) > 0.5


def test_the_same_call_gives_the_same_bits(monkeypatch):
    monkeypatch.setattr(material_trials, "_STEPS", 6)
    samples, lights, _ = photos(0.1, 2)
    errors = []
    for _ in range(2):
        trial = material_trials.Trial(STARTS[1], samples, lights, 0.4, CONFIG, 0)
        trial.fit()
        errors.append(trial.error())
    assert errors[0] == errors[1]


@pytest.mark.parametrize(("errors", "best", "expected"), [
    ([3.0, 1.0, 3.0, 5.0], 1, 1.0),  # nearly even on both sides
    ([1.0, 2.0, 3.0, 4.0], 0, 1.0),  # at the end of the range
])  # fmt: skip
def test_the_lowest_point_of_the_parabola(errors, best, expected):
    assert material_trials._vertex(errors, best) == pytest.approx(expected, abs=0.06)


def test_the_lowest_point_leans_towards_the_lower_neighbour():
    assert material_trials._vertex([1.5, 1.0, 3.0, 5.0], 1) > 1  # the brighter start is the better neighbour


def test_no_pixels_no_trial():
    samples, lights, _ = photos(0.1, 1)
    empty = [Sample(s.name, s.pixels.select(torch.arange(0)), s.color[:0], s.clipped[:0], 0.0) for s in samples]
    assert best_trial(empty, lights, 0.4, CONFIG, 0) is None

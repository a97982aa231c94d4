"""Parts of an object agree about their light when the surface is taken for what it is."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.core.device import generator
from lightprobe.light.prefilter import cached
from lightprobe.reconstruction.trials import disagreement as module
from lightprobe.reconstruction.trials.disagreement import SPLITS, disagreement
from lightprobe.render.split_sum import shade
from tests.gbuffers import sky, sphere_gbuffer

CONFIG = DecomposeConfig()


def two_materials():
    """Return a glossy ball, bright on one side and nearly black on the other, its photo and its light."""
    ball = sphere_gbuffer(2000, roughness=0.25, base=(0.6, 0.5, 0.4))
    dark = (ball.position[:, 1:2] * ball.position[:, 2:3] > 0).float()  # in quarters
    true = replace(ball, base_color=ball.base_color * (1 - 0.95 * dark))
    operator = cached(CONFIG.light_resolution)
    light = 0.5 * sky(CONFIG.light_resolution).clamp(max=3)
    return true, shade(true, operator, operator.apply(light)), light


def error(pixels, photo, light):
    clipped = torch.zeros_like(photo, dtype=torch.bool)
    found = disagreement(pixels, photo, clipped, light, CONFIG, generator(0, "test"))
    assert found is not None
    assert found.shape == (SPLITS,)
    return float(found.mean())


@pytest.mark.slow
@pytest.mark.parametrize("dark", [0.3, 1.0])
def test_dark_parts_taken_for_bright_ones_make_the_parts_disagree(dark):
    true, photo, light = two_materials()
    bright = true.base_color.amax(0).expand_as(true.base_color)
    wrong = replace(true, base_color=torch.maximum(true.base_color, dark * bright))
    assert error(wrong, photo, light) > 20 * error(true, photo, light) + 1e-3


@pytest.mark.slow
def test_of_a_photo_that_the_surface_explains_nothing_is_left():
    true, photo, light = two_materials()
    assert error(true, photo, light) < 1e-3


@pytest.mark.slow
def test_a_light_is_solved_from_the_colours_of_its_own_pixels(monkeypatch):
    true, photo, light = two_materials()
    solve, brighter = module.solve_through, []

    def checked(transport, observed, *rest):
        explained = transport.apply(light)
        brighter.append(round(float((observed - explained).mean()), 3))
        torch.testing.assert_close(observed, explained + brighter[-1], rtol=1e-3, atol=1e-4)
        return solve(transport, observed, *rest)

    monkeypatch.setattr(module, "solve_through", checked)
    error(true, photo + 0.1, light)
    assert brighter == SPLITS * [0.1, 0.1, 0.0, 0.0]  # the photo, and what the surface explains


def test_too_few_pixels_say_nothing():
    true, photo, light = two_materials()
    few = torch.arange(10)
    clipped = torch.zeros(10, 3, dtype=torch.bool)
    assert disagreement(true.select(few), photo[few], clipped, light, CONFIG, generator(0, "test")) is None

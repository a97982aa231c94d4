"""The correction of a prior: it mends what the photo shows, scales with the prior, and knows when to leave it
alone.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.config import SolveConfig
from lightprobe.light import cubemap
from lightprobe.prediction.observation import observe
from lightprobe.prediction.solve import changed, solve_environment
from tests.lit_sphere import CPU, glossy_sphere, patch_light, photograph
from tests.shapes import camera_at

CAMERA = camera_at((2.6, 1.4, 1.2), size=64, focal=85.0)
LIGHT = patch_light((1.0, 0.3, 0.4))
FRONT = cubemap.directions(16) @ torch.nn.functional.normalize(torch.tensor([2.6, 1.4, 1.2]), dim=0) > 0.3


@pytest.fixture(scope="module")
def observation():
    asset = glossy_sphere()
    return observe(asset, photograph(asset, CAMERA, LIGHT), CAMERA, CPU, 65_536)


def solve(observation, prior):
    return solve_environment(observation, prior, SolveConfig(), 0)


def log_error(light):
    return float(((light + 0.05).log() - (LIGHT + 0.05).log())[FRONT].square().mean().sqrt())


def test_a_true_prior_is_kept(observation):
    assert float((solve(observation, LIGHT) / LIGHT).log().abs().max()) < 0.05


def test_a_lamp_too_dim_and_a_sky_too_red_are_mended(observation):
    inside = LIGHT[..., :1] > 2
    prior = torch.where(inside, 0.4 * LIGHT, LIGHT * torch.tensor([1.5, 1.0, 0.8]))
    assert log_error(solve(observation, prior)) < 0.5 * log_error(prior)


def test_clipped_pixels_do_not_hold_a_lamp_down(observation):
    clipped = observation.pixels.color > 0.7 * observation.pixels.color.max()
    color = observation.pixels.color.clamp(max=float(0.7 * observation.pixels.color.max()))
    cut = replace(observation, clipped=clipped, pixels=observation.pixels.photographed(color))
    blind = replace(cut, clipped=torch.zeros_like(clipped))
    seen, unseen = (float(solve(o, LIGHT).max()) for o in (cut, blind))
    assert seen > 0.97 * float(LIGHT.max())
    assert unseen < seen


@pytest.mark.parametrize("unit", [1e3, 1e-4])
def test_the_unit_of_radiance_does_not_matter(observation, unit):
    asset, prior = glossy_sphere(), torch.where(LIGHT[..., :1] > 2, 0.4 * LIGHT, LIGHT)
    pixels = photograph(asset, CAMERA, LIGHT)
    other = observe(asset, replace(pixels, color=pixels.color * np.float32(unit)), CAMERA, CPU, 65_536)
    torch.testing.assert_close(
        solve(other, unit * prior) / unit, solve(observation, prior), rtol=1e-3, atol=1e-4
    )


def test_factors_are_smooth_bounded_and_multiply():
    change = torch.zeros(384, 3)
    torch.testing.assert_close(changed(LIGHT, change), LIGHT)
    change[:] = -5.0
    torch.testing.assert_close(changed(LIGHT, change), LIGHT / 10)
    change[:] = 0.5
    torch.testing.assert_close(changed(LIGHT, change), 1.5 * LIGHT)

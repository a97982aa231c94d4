"""The tone curve and its slope, clipping that bounds from one side, weights and units that follow the exposure."""

import math

import pytest
import torch

from lightprobe.light.photometry import (
    USUAL_MEAN,
    displayed_error,
    exposure_unit,
    luma,
    one_sided,
    one_sided_residual,
    relative_tone_weight,
    tone_map,
    tone_slope,
    tone_weight,
)


def test_the_tone_curve_is_that_of_the_paper():
    shown = tone_map(torch.tensor([-1.0, 0.0, 0.001, 0.18, 1.0, math.e - 1], dtype=torch.float64))
    known = [0.0, 0.0, 12.92 * math.log(1.001), *(1.055 * math.log(1 + x) ** (1 / 2.4) - 0.055 for x in (0.18, 1.0)), 1]
    assert shown.tolist() == pytest.approx(known, abs=1e-6)


def test_the_stated_slope_follows_the_curve():
    linear = torch.logspace(-3, 0, 200, dtype=torch.float64).requires_grad_()
    (true,) = torch.autograd.grad(tone_map(linear).sum(), linear)
    ratio = true / tone_slope(linear.detach())
    assert 1.0 < ratio.max() / ratio.min() < 6.0
    assert torch.allclose(tone_weight(linear), tone_slope(linear).square())


def test_clipped_pixels_only_bound_the_light_from_below():
    photo = torch.tensor([[0.7, 0.7, 0.7], [0.5, 0.5, 0.5]])  # the first is the mean of a white and darker pixels
    clipped = torch.tensor([[True] * 3, [False] * 3])
    brighter = torch.tensor([[7.0, 7.0, 7.0], [0.6, 0.6, 0.6]])
    assert torch.equal(one_sided(brighter, photo, clipped)[0], photo[0])
    assert torch.equal(one_sided(brighter, photo, clipped)[1], brighter[1])
    darker = 0.5 * photo
    assert torch.equal(one_sided(darker, photo, clipped), darker)
    for render in (brighter, darker):
        residual = one_sided_residual(render, photo, clipped)
        assert torch.equal(residual, one_sided(render, photo, clipped) - photo)
    assert not one_sided_residual(brighter, photo, clipped)[0].any()
    assert torch.equal(one_sided_residual(brighter, photo, clipped)[1], (brighter - photo)[1])
    assert torch.equal(one_sided_residual(darker, photo, clipped), darker - photo)


def test_a_clipped_pixel_that_is_rendered_brighter_is_no_error():
    photo, render = torch.full((4, 3), 0.9), torch.full((4, 3), 2.0)
    assert displayed_error(render, photo, torch.ones(4, 3, dtype=torch.bool)) == 0
    assert displayed_error(render, photo, torch.zeros(4, 3, dtype=torch.bool)) > 0.1


def test_weights_and_units_follow_the_exposure():
    color, level = torch.rand(50, 3) + 0.01, torch.tensor(0.7)
    assert torch.allclose(relative_tone_weight(8 * color, 8 * level), relative_tone_weight(color, level))
    assert float((color / exposure_unit(color)).mean()) == pytest.approx(USUAL_MEAN)
    assert torch.allclose(exposure_unit(8 * color), 8 * exposure_unit(color))
    assert exposure_unit(torch.zeros(2, 3)) > 0  # a black photo divides by something


def test_luma_weighs_as_equation_6_does():
    assert luma(torch.eye(3)).tolist() == pytest.approx([0.299, 0.587, 0.114])

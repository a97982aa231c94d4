"""The tone curve and its slope, clipping that bounds from one side, weights and units that follow the exposure."""

import math

import pytest
import torch

from lightprobe.light.photometry import (
    beyond_clipping,
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
    bright = [1.055 * math.log(1 + x) ** (1 / 2.4) - 0.055 for x in (0.18, 1.0)]
    known = [0.0, 0.0, 12.92 * math.log(1.001), *bright, 1]
    assert shown.tolist() == pytest.approx(known, abs=1e-6)


def test_the_stated_slope_follows_the_curve():
    linear = torch.logspace(-3, 0, 200, dtype=torch.float64).requires_grad_()
    (true,) = torch.autograd.grad(tone_map(linear).sum(), linear)
    ratio = true / tone_slope(linear.detach())
    assert 1.0 < ratio.max() / ratio.min() < 6.0
    assert torch.allclose(tone_weight(linear), tone_slope(linear).square())


def test_slope_and_weight_are_powers_of_what_is_above_black() -> None:
    linear = torch.tensor([-1.0, 0.0, 0.98, 6.23], dtype=torch.float64)
    slope = [0.02**-0.55, 0.02**-0.55, 1.0, 6.25**-0.55]
    assert tone_slope(linear).tolist() == pytest.approx(slope)
    assert tone_weight(linear).tolist() == pytest.approx([value**2 for value in slope])


def test_a_relative_weight_is_one_over_the_mean_colour_in_light_levels_and_a_twentieth() -> None:
    color = torch.tensor([[0.1, 0.2, 0.6], [0.0, 0.0, 0.0]], dtype=torch.float64)
    weight = relative_tone_weight(color, torch.tensor(2.0, dtype=torch.float64))
    assert weight.tolist() == pytest.approx([1 / (0.15 + 0.05), 20])


def test_only_what_is_clipped_and_rendered_brighter_is_beyond_clipping() -> None:
    render, photo, clipped = torch.tensor([1.0, 0.8, 0.7, 1.0]), torch.full((4,), 0.8), torch.arange(4) < 3
    assert beyond_clipping(render, photo, clipped).tolist() == [True, False, False, False]
    assert one_sided(render, photo, clipped).tolist() == pytest.approx([0.8, 0.8, 0.7, 1.0])
    assert one_sided_residual(render, photo, clipped).tolist() == pytest.approx([0, 0, -0.1, 0.2])


def test_the_displayed_error_is_a_mean_of_sizes() -> None:
    white = math.e - 1  # shown as 1
    render = torch.tensor([[white, 0.0, 0.0], [0.0, 0.0, white]])
    photo = torch.tensor([[0.0] * 3, [0.0, white, 0.0]])
    nowhere = torch.zeros(2, 3, dtype=torch.bool)
    assert float(displayed_error(render, photo, nowhere)) == pytest.approx(3 / 6)
    first = nowhere.clone()
    first[0, 0] = True
    assert float(displayed_error(render, photo, first)) == pytest.approx(2 / 6)


def test_a_photo_is_divided_by_its_mean_over_that_of_a_well_exposed_one() -> None:
    assert float(exposure_unit(torch.tensor([[0.1, 0.2, 0.36]]))) == pytest.approx(0.22 / 0.22)
    assert float(exposure_unit(torch.tensor([[0.0, 0.0, 3.3]]))) == pytest.approx(5)
    assert float(exposure_unit(torch.zeros(2, 3))) == pytest.approx(1e-9 / 0.22)


def test_luma_is_a_sum_over_the_last_axis_in_the_colours_own_precision() -> None:
    color = torch.tensor([[[1.0, 2.0, 4.0], [0.0, 10.0, 0.0]]], dtype=torch.float64)
    assert luma(color).shape == (1, 2)
    assert luma(color)[0].tolist() == pytest.approx([0.299 + 1.174 + 0.456, 5.87], abs=1e-12)

"""Lights at other resolutions and turned: means by solid angle, repeated texels, and what stands where."""

import math

import numpy as np
import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.resize import magnify_light, resize_light, rotate_light


def some_light(resolution: int) -> torch.Tensor:
    return torch.rand(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(resolution))


def solid_angle(row: int, column: int, resolution: int, steps: int = 60) -> float:
    """Return a texel's solid angle by the midpoint rule over 1 / (1 + a^2 + b^2)^1.5."""
    inner = (np.arange(steps) + 0.5) / steps
    a, b = ((place + inner) * 2 / resolution - 1 for place in (column, row))
    return float(((1 + a**2 + b[:, None] ** 2) ** -1.5).sum()) * (2 / resolution / steps) ** 2


def test_a_coarser_light_is_the_mean_over_solid_angles() -> None:
    light, coarse = some_light(8), resize_light(some_light(8), 2)
    assert coarse.shape == (6, 2, 2, 3)
    angle = np.array([[solid_angle(row, column, 8) for column in range(8)] for row in range(8)])
    for face, row, column in ((0, 0, 1), (3, 1, 0), (5, 1, 1)):
        rows, columns = slice(4 * row, 4 * row + 4), slice(4 * column, 4 * column + 4)
        values, weight = light[face, rows, columns].numpy(), angle[rows, columns, None]
        expected = (values * weight).sum((0, 1)) / weight.sum()
        assert coarse[face, row, column].tolist() == pytest.approx(expected.tolist(), rel=1e-4)


def test_a_finer_light_repeats_texels_and_one_of_the_same_size_is_the_same_to_the_bit() -> None:
    light, fine = some_light(2), resize_light(some_light(2), 8)
    assert fine.shape == (6, 8, 8, 3)
    for row in range(8):
        for column in range(8):
            assert torch.equal(fine[:, row, column], light[:, row // 4, column // 4])
    assert torch.equal(resize_light(some_light(16), 16), some_light(16))


def test_a_magnified_light_is_bilinear_between_texel_centres() -> None:
    light = some_light(2)
    fine = magnify_light(light, 4)
    assert fine.shape == (6, 4, 4, 3)
    shares = torch.tensor([[9, 3, 3, 1], [3, 9, 1, 3], [3, 1, 9, 3], [1, 3, 3, 9]]) / 16
    for (row, column), share in zip(((1, 1), (1, 2), (2, 1), (2, 2)), shares, strict=True):
        torch.testing.assert_close(fine[:, row, column], (light.reshape(6, 4, 3) * share[:, None]).sum(1))
    assert magnify_light(light, 2) is light


def test_a_turned_light_shows_in_every_direction_what_the_light_has_in_the_turned_direction() -> None:
    turn = torch.tensor([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])  # carries faces onto faces
    towards = cubemap.directions(4)
    torch.testing.assert_close(rotate_light(towards, turn, 4), towards @ turn.T, atol=1e-6, rtol=0)
    cosine, sine = math.cos(0.3), math.sin(0.3)
    tilt = torch.tensor([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    fine = cubemap.directions(32)
    assert (rotate_light(fine, tilt, 32) - fine @ tilt.float().T).norm(dim=-1).max() < 0.03


def test_a_turned_light_of_another_size_is_averaged_or_interpolated() -> None:
    light, still = some_light(4), torch.eye(3)
    torch.testing.assert_close(rotate_light(light, still, 2), resize_light(light, 2))
    torch.testing.assert_close(rotate_light(light, still, 8), magnify_light(light, 8))

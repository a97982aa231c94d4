"""Rows of the lobe: its energy, a furnace, no negative weight, and light that is averaged where the lobe is."""

import itertools
import math

import numpy as np
import pytest
import scipy.integrate
import torch

from lightprobe.light import cubemap
from lightprobe.light.lobes import Nodes, _lobe_integral, _lobe_of_cosine, narrow_rows, wide_rows

R = 16
NODES = Nodes(R, 8)
ALPHAS = [0.05, 0.2, 0.5, 0.9, 0.99999, 1.0]


def some_directions(count: int = 12) -> np.ndarray:
    drawn = np.random.default_rng(8).normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_energy_of_a_lobe_is_its_integral_over_the_sphere(alpha):
    """In closed form, and by quadrature over the angle."""

    def ring(angle: float) -> float:
        return float(_lobe_of_cosine(np.cos([angle]), alpha)[0]) * 2 * math.pi * math.sin(angle)

    edges = [0, *(alpha * k for k in (0.5, 1, 2, 4) if alpha * k < 1.5), math.pi / 2]
    energy = sum(scipy.integrate.quad(ring, a, b)[0] for a, b in itertools.pairwise(edges))
    assert _lobe_integral(alpha) == pytest.approx(energy, rel=1e-4)  # next to 1 it is taken for a cosine


@pytest.mark.parametrize("alpha", [0.05, 0.2, 0.5])
def test_narrow_rows_pass_a_furnace(alpha):
    check_furnace(narrow_rows(some_directions(), alpha, NODES, 0.01))


@pytest.mark.parametrize("alpha", [0.5, 0.9, 1.0])
def test_wide_rows_pass_a_furnace(alpha):
    check_furnace(wide_rows(some_directions(), alpha, NODES))


def check_furnace(rows) -> None:
    """No weight is negative, and light that is the same everywhere comes back as it is."""
    assert rows.data.min() >= 0
    constant = rows @ (NODES.matrix() @ np.full(6 * R * R, 0.7))
    np.testing.assert_allclose(constant, 0.7, rtol=1e-6)


@pytest.mark.parametrize("alpha", [0.5, 0.7])
def test_narrow_and_wide_rows_average_the_same_light(alpha):
    """And it is the mean that the lobe's own definition gives, by a sum over a fine grid."""
    towards = some_directions()
    light = 1 + cubemap.exact_directions(R).reshape(-1, 3).numpy() @ np.array([0.3, 0.5, -0.2])
    fine = cubemap.exact_directions(64).reshape(-1, 3).numpy()
    lobe = _lobe_of_cosine(towards @ fine.T, alpha) * cubemap.exact_solid_angles(64).numpy().ravel()
    expected = lobe @ (1 + fine @ np.array([0.3, 0.5, -0.2])) / lobe.sum(1)
    means = NODES.matrix() @ light
    np.testing.assert_allclose(narrow_rows(towards, alpha, NODES, 0.01) @ means, expected, rtol=0.02)
    np.testing.assert_allclose(wide_rows(towards, alpha, NODES) @ means, expected, rtol=0.02)


def test_a_light_on_one_side_is_not_seen_from_the_other():
    """A lobe ends at a right angle from its direction: what is more than a square beyond has no weight."""
    light = (cubemap.directions(R)[..., 2] < -0.5).float().reshape(-1).numpy()
    up = np.array([[0.0, 0.0, 1.0]])
    for rows in (narrow_rows(up, 0.3, NODES, 0.01), wide_rows(up, 0.9, NODES)):
        assert float((rows @ (NODES.matrix() @ light))[0]) < 1e-3
    assert torch.from_numpy(light).any()

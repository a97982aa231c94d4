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


def test_rows_pass_a_furnace():
    """No weight is negative, and light that is the same everywhere comes back as it is."""
    narrow = [narrow_rows(some_directions(), alpha, NODES, 0.01) for alpha in (0.05, 0.2, 0.5)]
    for rows in (*narrow, *(wide_rows(some_directions(), alpha, NODES) for alpha in (0.5, 0.9, 1.0))):
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


def test_nodes_are_the_squares_of_all_sizes_and_then_the_tents() -> None:
    nodes = Nodes(8, 4)
    assert (nodes.squares, nodes.total) == (6 * (4 + 16 + 64), 6 * (4 + 16 + 64) + 6 * 16)
    assert nodes.matrix().shape == (nodes.total, 6 * 64)
    assert nodes.sources().shape == (48, nodes.total)


def test_a_square_is_the_mean_of_its_texels_by_solid_angle_and_a_tent_as_fine_as_the_light_is_a_texel():
    matrix, angle = Nodes(4, 4).matrix().toarray(), cubemap.exact_solid_angles(4).numpy().ravel()
    for face, row, column in ((0, 0, 1), (3, 1, 0), (5, 1, 1)):
        texels = 16 * face + 8 * row + 2 * column + np.array([0, 1, 4, 5])
        expected = np.zeros(96)
        expected[texels] = angle[texels] / angle[texels].sum()
        np.testing.assert_allclose(matrix[4 * face + 2 * row + column], expected, atol=1e-12)
    np.testing.assert_allclose(matrix[24:120], np.eye(96), atol=1e-12)
    np.testing.assert_allclose(matrix[120:], np.eye(96), atol=1e-12)


def test_a_coarse_tent_weighs_texels_by_their_solid_angle_and_how_near_they_are() -> None:
    """Of a light of 4 x 4 in tents of 2 x 2, a quarter of a tent's width apart, where no edge is near."""
    tent = Nodes(4, 2).matrix().toarray()[24 + 96 + 4 * 4]  # the first of +z
    angle = cubemap.exact_solid_angles(4)[4, 1:3, 1:3].numpy()
    share = np.array([[9, 3], [3, 1]]) * angle
    found = tent.reshape(6, 4, 4)[4, 1:3, 1:3] / tent[64 + 5]
    np.testing.assert_allclose(found, share / share[0, 0], rtol=1e-6)


def test_narrow_rows_use_squares_alone_and_wide_ones_tents_alone() -> None:
    towards = some_directions(3)
    assert narrow_rows(towards, 0.2, NODES, 0.01).indices.max() < NODES.squares
    wide = wide_rows(towards, 0.9, NODES)
    assert wide.shape == (3, NODES.total)
    assert wide.indices.min() >= NODES.squares
    assert wide.toarray().sum(1) == pytest.approx(1)

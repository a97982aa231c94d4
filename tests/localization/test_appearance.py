"""Appearance turns light's factors into offsets."""

import numpy as np
import torch

from lightprobe.localization.appearance import PhotoPyramid, appearance, edge_field


def test_a_brighter_or_tinted_light_adds_constants():
    color = torch.rand(50, 3, generator=torch.Generator().manual_seed(0)) + 0.5
    plain = appearance(color)
    brighter = appearance(1.5 * color) - plain
    assert torch.allclose(brighter[:, 0], torch.tensor(1.5).log().expand(50), atol=0.02)
    assert brighter[:, 1:].abs().max() < 0.02
    tinted = appearance(color * torch.tensor([2.0, 1.0, 1.0])) - plain
    assert torch.allclose(tinted[:, 1], torch.tensor(2.0).log().expand(50), atol=0.03)


def test_edges_know_their_direction_not_their_sign():
    picture = np.zeros((9, 9, 3), np.float32)
    picture[:, 5:] = 1
    across = edge_field(picture)[4, 4]
    assert across[0] > 0.7
    assert abs(across[1]) < 1e-6
    assert np.allclose(edge_field(-picture)[4, 4], across)
    down = edge_field(picture.transpose(1, 0, 2))[4, 4]
    assert np.allclose(down, -across, atol=1e-6)
    assert np.abs(edge_field(picture)[:, :2]).max() == 0


def test_sizes_come_in_steps_and_never_beyond_the_photo():
    color = np.random.default_rng(0).random((40, 60, 3))
    pyramid = PhotoPyramid(color)
    assert pyramid.near(3.0).size == pyramid.near(1.0).size == pyramid.size == (60, 40)
    assert pyramid.near(0.42) is pyramid.near(0.45)
    half = pyramid.near(0.5)
    assert 0.5 * 60 / 1.2 <= half.size[0] <= 0.5 * 60 * 1.2
    assert np.isclose(half.color.mean(), color.mean(), atol=1e-3)


def test_gradients_are_per_pixel_and_clipped_stays_clipped():
    ramp = np.broadcast_to(np.linspace(0, 0.9, 50)[None, :, None], (30, 50, 3)).copy()
    ramp[12, 20] = 1.0
    level = PhotoPyramid(ramp).near(1.0)
    assert np.allclose(level.gradient[25, 10, 0], [0.9 / 49, 0], atol=1e-6)
    assert level.clipped.sum() == 3
    assert PhotoPyramid(ramp).near(0.3).clipped.any()

"""A photo at several sizes."""

import numpy as np

from lightprobe.localization.level import Levels


def test_sizes_come_in_steps_and_never_beyond_the_photo():
    color = np.random.default_rng(0).random((40, 60, 3))
    levels = Levels(color)
    assert levels.near(3.0).size == levels.near(1.0).size == levels.size == (60, 40)
    assert levels.near(0.42) is levels.near(0.45)
    half = levels.near(0.5)
    assert 0.5 * 60 / 1.2 <= half.size[0] <= 0.5 * 60 * 1.2
    assert np.isclose(half.color.mean(), color.mean(), atol=1e-3)


def test_gradients_are_per_pixel_and_clipped_stays_clipped():
    ramp = np.broadcast_to(np.linspace(0, 0.9, 50)[None, :, None], (30, 50, 3)).copy()
    ramp[12, 20] = 1.0
    level = Levels(ramp).near(1.0)
    assert np.allclose(level.gradient[25, 10, 0], [0.9 / 49, 0], atol=1e-6)
    assert level.clipped.sum() == 3
    assert Levels(ramp).near(0.3).clipped.any()

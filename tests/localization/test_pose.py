"""Steps of a camera, and the motion that they are linearised by."""

import numpy as np
import pytest

from lightprobe.localization.pose import PARAMETERS, least_rotation, mean_distance, motion, moved, rotation_of
from tests.shapes import camera_at

CAMERA = camera_at((2.0, 1.5, 1.0), size=100, focal=150.0)
POINTS = 0.4 * np.random.default_rng(0).normal(size=(20, 3))


@pytest.mark.parametrize("number", range(PARAMETERS))
def test_motion_is_the_derivative_of_the_projection(number):
    step = np.zeros(PARAMETERS)
    step[number] = 1e-6
    ahead, back = (moved(CAMERA, sign * step).project(POINTS)[:, :2] for sign in (1, -1))
    assert np.allclose((ahead - back) / 2e-6, motion(CAMERA, POINTS)[:, :, number], atol=1e-5)


def test_a_longer_focal_length_keeps_the_size():
    longer = moved(CAMERA, np.array([0, 0, 0, 0, 0, 0, 0.2]))
    assert longer.fx == pytest.approx(CAMERA.fx * np.exp(0.2))
    assert (
        mean_distance(CAMERA, longer, POINTS)
        < 3
        < mean_distance(CAMERA, moved(CAMERA, np.full(7, 0.1)), POINTS)
    )


def test_rotations():
    assert np.allclose(rotation_of(np.array([0, 0, np.pi / 2])) @ [1, 0, 0], [0, 1, 0])
    a, b = np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.6, -0.8])
    turn = least_rotation(a, b)
    assert np.allclose(turn @ a, b)
    assert np.allclose(turn @ turn.T, np.eye(3))
    assert np.allclose(turn @ np.cross(a, b), np.cross(a, b))  # about the axis across both, so the least

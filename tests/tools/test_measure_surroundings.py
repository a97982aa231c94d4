"""The statistics that evidence from surroundings rests on."""

import numpy as np
import pytest

from measure_surroundings import camera_from, environment_excess


def test_a_light_without_a_sun_is_as_bright_as_what_is_seen_of_it():
    assert environment_excess(np.full((32, 64, 3), 7.0, np.float32), 30) == pytest.approx([0.0] * 8, abs=1e-3)


def test_of_a_light_from_above_cameras_that_look_down_see_little():
    light = np.full((32, 64, 3), 0.1, np.float32)
    light[:16] = 1.0
    below, level = environment_excess(light, 60), environment_excess(light, 0)
    assert below == pytest.approx([below[0]] * 8, abs=0.05)
    assert below[0] > level[0] + 0.5


def test_cameras_look_at_the_origin_from_above():
    camera = camera_from(30, 90)
    assert camera.camera_to_world[:3, 3] == pytest.approx([0, 4 * np.cos(np.pi / 6), 2])
    assert -camera.camera_to_world[:3, 2] * 4 == pytest.approx(-camera.camera_to_world[:3, 3])
    assert np.linalg.det(camera.camera_to_world[:3, :3]) == pytest.approx(1)

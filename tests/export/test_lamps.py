import math

import numpy as np
import pytest

from lightprobe.export.glb import DirectionalLight
from lightprobe.light.sources import LightSource


def turned(quaternion, vector) -> np.ndarray:
    x, y, z, w = quaternion
    axis = np.array([x, y, z])
    return vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)


@pytest.mark.parametrize(
    "direction", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1), (0, -1, 0), (0.48, 0.6, 0.64)]
)
def test_the_node_s_z_axis_points_to_the_source_in_the_y_up_frame(direction):
    light = DirectionalLight.of(LightSource(direction, 0.1, (3.0, 2.0, 1.0)))
    x, y, z = direction
    assert np.linalg.norm(light.quaternion()) == pytest.approx(1)
    assert turned(light.quaternion(), np.array([0.0, 0.0, 1.0])) == pytest.approx([x, z, -y], abs=1e-6)


def test_colour_times_intensity_is_the_irradiance():
    light = DirectionalLight.of(LightSource((1, 0, 0), math.radians(5), (3.0, 6.0, 1.5)))
    assert light.color == (0.5, 1.0, 0.25)
    assert light.intensity == 6.0
    assert light.angle == pytest.approx(10)
    assert DirectionalLight.of(LightSource((1, 0, 0), 0.1, (0.0, 0.0, 0.0))).intensity == 0.0

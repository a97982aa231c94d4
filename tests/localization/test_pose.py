"""Steps of a camera, and the motion that they are linearised by."""

import numpy as np
import pytest
import torch

from lightprobe.geometry.mesh import Mesh
from lightprobe.localization.pose import (
    PARAMETERS,
    least_rotation,
    mean_distance,
    motion,
    moved,
    rotation_of,
    symmetric_turns,
)
from tests.shapes import camera_at, sphere_mesh

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
    other = moved(CAMERA, np.full(7, 0.1))
    assert mean_distance(CAMERA, longer, POINTS) < 3 < mean_distance(CAMERA, other, POINTS)


def test_rotations():
    assert np.allclose(rotation_of(np.array([0, 0, np.pi / 2])) @ [1, 0, 0], [0, 1, 0])
    a, b = np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.6, -0.8])
    turn = least_rotation(a, b)
    assert np.allclose(turn @ a, b)
    assert np.allclose(turn @ turn.T, np.eye(3))
    assert np.allclose(turn @ np.cross(a, b), np.cross(a, b))  # about the axis across both, so the least


def stretched(*factors: float) -> Mesh:
    mesh = sphere_mesh(3)
    return Mesh(mesh.vertices * torch.tensor(factors), mesh.faces, mesh.uvs, mesh.uv_faces)


def test_an_egg_turns_about_its_axis_and_upside_down():
    turns = symmetric_turns(stretched(0.5, 0.5, 1.0))
    about = [turn for turn in turns if np.allclose(np.abs(turn.rotation[2, 2]), 1, atol=0.05)]
    assert len(about) >= 23
    assert all(abs(abs(turn.rotation[2, 2]) - 1) < 0.1 for turn in turns)


def test_a_pebble_turns_upside_down_alone():
    cosines = [(np.trace(turn.rotation) - 1) / 2 for turn in symmetric_turns(stretched(1.0, 0.6, 0.3))]
    angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    assert sum(angle > 179 for angle in angles) == 3
    assert not any(20 < angle < 160 for angle in angles)


def test_a_copy_sees_the_turned_object():
    turn = symmetric_turns(stretched(0.5, 0.5, 1.0))[3]
    camera = camera_at((2.0, 1.0, 0.5))
    points = 0.5 * np.random.default_rng(0).normal(size=(10, 3))
    turned = (points - turn.center) @ turn.rotation.T + turn.center
    assert np.allclose(turn.copy(camera).project(turned), camera.project(points))

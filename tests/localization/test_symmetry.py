"""Turns that bring a shape onto itself."""

import numpy as np
import torch

from lightprobe.geometry.mesh import Mesh
from lightprobe.localization.symmetry import symmetric_turns
from tests.shapes import camera_at, sphere_mesh


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

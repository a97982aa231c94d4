"""Lenses bend and are straightened again; a turned world shows the same."""

import numpy as np
import pytest

from lightprobe.preparation.solution import bent, straightened
from lightprobe.preparation.upright import rotation_to_z
from tests.preparation.ring import ball_points, photographed, ring_cameras


@pytest.mark.parametrize("k", [-0.2, -0.05, 0.0, 0.1])
def test_straightening_undoes_the_lens(k):
    camera = ring_cameras(1)[0]
    points = np.random.default_rng(0).uniform(0, 200, (50, 2))
    assert np.allclose(straightened(bent(points, camera, k), camera, k), points, atol=1e-6)
    corner = np.array([[0.0, 0.0]])
    radius = 100 * np.sqrt(2) / 300
    shift = 100 * np.sqrt(2) * k * radius**2
    assert np.linalg.norm(bent(corner, camera, k) - corner) == pytest.approx(abs(shift))


def test_a_turned_and_scaled_world_looks_the_same_to_its_cameras():
    _, _, solution = photographed(ring_cameras(3), ball_points(10))
    up = np.array([0.6, 0.0, 0.8])
    moved = solution.mapped(rotation_to_z(up, solution.pose), 2.5)
    for photo, camera in solution.cameras().items():
        before, after = camera.project(solution.points), moved.cameras()[photo].project(moved.points)
        assert np.allclose(before[:, :2], after[:, :2])
        assert np.allclose(2.5 * before[:, 2], after[:, 2])

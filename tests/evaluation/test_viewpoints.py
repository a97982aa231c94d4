import numpy as np
import pytest

from lightprobe.evaluation.viewpoints import look_at, surrounding, turntable
from lightprobe.scene.camera import Camera
from tests.shapes import camera_at

UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("position", [(3.0, 0, 0), (1.0, -2, 0.5), (0, 0, 4.0), (0, 0, -4.0)])
def test_look_at_is_a_rigid_camera_with_the_target_in_the_middle(position):
    camera = Camera(look_at(np.array(position), np.zeros(3), UP), 50, 50, 16, 16, 32, 32)
    camera.check("test")
    assert camera.project(np.zeros((1, 3)))[0] == pytest.approx([16, 16, np.linalg.norm(position)])


def test_surrounding_cameras_see_a_ball_whole_and_from_all_sides():
    cameras = surrounding(40, 64, radius=2.0)
    rim = 2.0 * np.random.default_rng(0).normal(size=(500, 3))
    rim = 2.0 * rim / np.linalg.norm(rim, axis=1, keepdims=True)
    for camera in cameras:
        x, y, depth = camera.project(rim).T
        assert depth.min() > 0
        assert min(x.min(), y.min()) >= 0
        assert max(x.max(), y.max()) <= 64
    assert np.abs(np.mean([c.position for c in cameras], axis=0)).max() < 0.3


def test_turntable_stands_upright_at_the_photos_distance():
    photos = [camera_at((3 * np.cos(a), 3 * np.sin(a), 1.0)) for a in np.linspace(0, 5, 9)]
    frames = turntable(photos, np.zeros(3), 8, 100)
    for camera in frames:
        camera.check("frame")
        assert np.linalg.norm(camera.position) == pytest.approx(np.sqrt(10))
        assert camera.camera_to_world[2, 1] > 0.8
        assert camera.project(np.zeros((1, 3)))[0, :2] == pytest.approx([50, 50])
    angles = np.unwrap([np.arctan2(c.position[1], c.position[0]) for c in frames])
    assert np.abs(np.abs(np.diff(angles)) - np.pi / 4).max() < 0.02

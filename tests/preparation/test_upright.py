"""Level cameras tell which way is up, in whatever frame they come."""

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.preparation.upright import (
    extent_along,
    parse_up,
    rotation_to_z,
    up_of_gravity,
    up_of_level_cameras,
)
from tests.preparation.ring import ring_cameras


def turned(poses: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rotation = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    moved = poses.copy()
    moved[:, :3] = rotation @ poses[:, :3]
    return moved, rotation


@pytest.mark.parametrize("seed", range(4))
def test_up_is_found_in_any_frame(seed):
    poses = np.stack([camera.camera_to_world for camera in ring_cameras(12)])
    moved, rotation = turned(poses, seed)
    found = up_of_level_cameras(moved)
    assert found.direction @ rotation[:, 2] > 0.9999
    assert found.doubt is None
    upright = rotation_to_z(found.direction, moved) @ rotation
    assert upright[:, 2] @ [0, 0, 1] > 0.9999
    assert np.linalg.det(upright) == pytest.approx(1)


def test_cameras_that_roll_make_up_doubtful():
    poses = np.stack([camera.camera_to_world for camera in ring_cameras(12)])
    for index, pose in enumerate(poses):
        c, s = np.cos(0.7 * (-1) ** index), np.sin(0.7 * (-1) ** index)
        pose[:3, :2] = pose[:3, :2] @ [[c, -s], [s, c]]
    assert "uncertain" in up_of_level_cameras(poses).doubt


def test_photos_from_one_side_leave_only_their_vertical_axis():
    pose = ring_cameras(12)[0].camera_to_world
    found = up_of_level_cameras(np.stack([pose] * 5))
    assert found.doubt
    assert found.direction @ pose[:3, 1] == pytest.approx(1)


@pytest.mark.parametrize("text", ["", "1,2", "a,b,c", "0,0,0", "nan,0,1", "1,2,3,4"])
def test_a_direction_that_is_none_is_refused(text):
    with pytest.raises(ConfigError, match="three numbers"):
        parse_up(text)


def test_a_direction_has_length_one():
    assert parse_up("0,-2,0").tolist() == [0, -1, 0]
    assert extent_along(np.array([[0, 0, 1.0], [5, 0, -1]]), [0, 0, 1]) == 2


def test_sensors_tell_up_where_they_agree():
    moved, rotation = turned(np.stack([camera.camera_to_world for camera in ring_cameras(6)]), 1)
    felt = [pose[:3, :3].T @ rotation[:, 2] for pose in moved]
    found = up_of_gravity(moved, [*felt[:4], None, None])
    assert found is not None
    assert found.direction @ rotation[:, 2] > 0.9999
    assert "4 photos" in found.source
    assert up_of_gravity(moved, [*felt[:2], None, None, None, None]) is None
    assert up_of_gravity(moved, [felt[0], -felt[1], felt[2], -felt[3], None, None]) is None

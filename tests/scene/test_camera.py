import json

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.scene import Camera, Similarity
from lightprobe.scene.camera import mean_up
from tests.scene.worlds import expected_camera, views
from tests.shapes import camera_at

POINTS = np.random.default_rng(1).normal((3.3, 1.0, 2.2), 1.0, (9, 3))


@pytest.fixture
def camera():
    return expected_camera(views(5, varied=True)[3])


def test_json_round_trip_is_exact(camera):
    again = Camera.from_json(json.loads(json.dumps(camera.to_json())), source="c.json")
    assert (again.camera_to_world == camera.camera_to_world).all()
    assert again.to_json() == camera.to_json()


def test_resizing_scales_the_pixels(camera):
    scaled = camera.resized(camera.width * 3, camera.height * 2).project(POINTS)
    np.testing.assert_allclose(scaled, camera.project(POINTS) * (3, 2, 1))


def test_scaling_keeps_the_view_and_at_least_a_pixel(camera):
    half = camera.scaled(0.5)
    assert (half.width, half.height) == (camera.width // 2, camera.height // 2)
    np.testing.assert_allclose(half.project(POINTS)[:, :2], camera.project(POINTS)[:, :2] / 2)
    assert camera.scaled(1e-6).width == camera.scaled(1e-6).height == 1


def test_a_camera_is_shrunk_but_never_enlarged(camera):
    longest = max(camera.width, camera.height)
    assert camera.within(longest) is camera
    smaller = camera.within(longest // 4)
    assert max(smaller.width, smaller.height) == longest // 4


def test_normalising_changes_no_pixel_and_no_direction(camera):
    similarity = Similarity(np.array([1.0, -2.0, 0.5]), 2.5)
    moved = camera.normalised(similarity)
    projected = moved.project(similarity.apply(POINTS))
    np.testing.assert_allclose(projected[:, :2], camera.project(POINTS)[:, :2], atol=1e-9)
    np.testing.assert_allclose(projected[:, 2] * 2.5, camera.project(POINTS)[:, 2])
    assert (moved.camera_to_world[:3, :3] == camera.camera_to_world[:3, :3]).all()
    np.testing.assert_allclose(similarity.invert(similarity.apply(POINTS)), POINTS)
    assert Similarity.from_json(similarity.to_json()).to_json() == similarity.to_json()


def test_points_behind_have_negative_depth(camera):
    behind = camera.position + camera.camera_to_world[:3, 2]
    assert camera.project(behind[None])[0, 2] == pytest.approx(-1)


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        ({"fx": None}, "not a number"),
        ({"fx": "wide"}, "not a number"),
        ({"width": 1e999}, "not a number"),
        ({"fy": float("nan")}, "NaN or infinity"),
        ({"height": 0}, "must be positive"),
        ({"camera_to_world": [[1, 0], [0, 1]]}, "4x4 matrix, not 2x2"),
        ({"camera_to_world": [[1, 0], [0]]}, "not a number"),
        ({"camera_to_world": np.diag([1.0, 1, -1, 1]).tolist()}, "not a rotation"),
    ],
)
def test_bad_cameras_are_named(camera, change, pattern):
    with pytest.raises(InputError, match=rf"c\.json.*{pattern}"):
        Camera.from_json({**camera.to_json(), **change}, source="c.json")


def test_missing_key_and_wrong_type(camera):
    value = camera.to_json()
    del value["cx"]
    with pytest.raises(InputError, match=r"c\.json has no key 'cx'"):
        Camera.from_json(value, source="c.json")
    with pytest.raises(InputError, match=r"c\.json must hold a JSON object"):
        Camera.from_json([1, 2], source="c.json")


def test_up_is_where_the_cameras_say():
    tilted = [camera_at((2.0, x, 0.8)).camera_to_world[:3, 1] for x in (-2.0, 0.5, 2.0)]
    assert mean_up(tilted)[2] > 0.9
    assert mean_up([tilted[1], -tilted[1]]).tolist() == [0.0, 0.0, 1.0]

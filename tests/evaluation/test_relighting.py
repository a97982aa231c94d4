import dataclasses
import math

import numpy as np
import pytest
import torch
from torch import Tensor

from lightprobe.core.config.rendering import RenderConfig, Renderer
from lightprobe.evaluation import relighting
from lightprobe.evaluation.relighting import Relighter, cameras_around, look_at, relight, turntable
from lightprobe.light.environment import Environment
from lightprobe.render.asset import Asset
from lightprobe.scene.camera import Camera
from tests.known_scene import CPU, SIMILARITY, known_decomposition
from tests.shapes import camera_at

UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("position", [(3.0, 0, 0), (1.0, -2, 0.5), (0, 0, 4.0), (0, 0, -4.0)])
def test_look_at_is_a_rigid_camera_with_the_target_in_the_middle(position):
    camera = Camera(look_at(np.array(position), np.zeros(3), UP), 50, 50, 16, 16, 32, 32)
    camera.check("test")
    assert camera.project(np.zeros((1, 3)))[0] == pytest.approx([16, 16, np.linalg.norm(position)])


def test_surrounding_cameras_see_a_ball_whole_and_from_all_sides():
    cameras = cameras_around(40, 64, radius=2.0)
    rim = 2.0 * np.random.default_rng(0).normal(size=(500, 3))
    rim = 2.0 * rim / np.linalg.norm(rim, axis=1, keepdims=True)
    for camera in cameras:
        x, y, depth = camera.project(rim).T
        assert depth.min() > 0
        assert min(x.min(), y.min()) >= 0
        assert max(x.max(), y.max()) <= 64
    assert np.abs(np.mean([c.position for c in cameras], axis=0)).max() < 0.3


def photo(
    offset: tuple[float, ...], up: tuple[float, ...], fx: float = 50.0, size: tuple[int, int] = (50, 50)
) -> Camera:
    """Return a photo's camera of which place, top and focal length alone matter."""
    pose = np.eye(4)
    pose[:3, 1], pose[:3, 3] = up, CENTER + offset
    return Camera(pose, fx, 2 * fx, 7.0, 5.0, *size)


CENTER = np.array([10.0, -20.0, 30.0])


LEAN = 3**0.5 / 2  # cos 30 degrees


@pytest.mark.parametrize("axes", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_a_turntable_has_the_photos_median_distance_height_and_framing(axes: tuple[int, ...]) -> None:
    """It starts at the first photo's side and turns anticlockwise seen from above, whatever axis is upwards."""
    offsets = [(3.0, 0.0, 4.0), (0.0, 8.0, 6.0), (-2.0, 0.0, 0.0)]  # distances 5, 10, 2, heights .8, .6, 0
    ups = [(0.5, 0.0, LEAN), (-0.5, 0.0, LEAN), (0.0, 0.0, 1.0)]
    intrinsics = [(80.0, (100, 60)), (30.0, (40, 60)), (90.0, (90, 90))]  # .8, .5 and 1 of the longer side
    order = np.argsort(axes)
    photos = [
        photo(tuple(np.array(offset)[order]), tuple(np.array(up)[order]), *how)
        for offset, up, how in zip(offsets, ups, intrinsics, strict=True)
    ]
    frames = turntable(photos, CENTER, 4, 200)
    expected = np.array([[4.0, 0, 3], [0, 4, 3], [-4, 0, 3], [0, -4, 3]])[:, order]
    assert np.array([frame.position for frame in frames]) - CENTER == pytest.approx(expected, abs=1e-9)
    for frame in frames:
        assert frame.fx == frame.fy == pytest.approx(160)
        assert (frame.cx, frame.cy, frame.width, frame.height) == (100, 100, 200, 200)
        assert frame.camera_to_world[:3, 1] @ np.array([0.0, 0, 1])[order] == pytest.approx(0.8)
        assert frame.camera_to_world[:3, 2] == pytest.approx((frame.position - CENTER) / 5)


@pytest.mark.parametrize(("height", "kept"), [(0.95, 0.9), (0.85, 0.85), (-0.85, -0.85), (-0.95, -0.9)])
def test_a_turntable_looks_neither_straight_down_nor_up(height: float, kept: float) -> None:
    above = photo((4 * (1 - height**2) ** 0.5, 0.0, 4 * height), (0.0, 0.0, 1.0))
    for frame in turntable([above], CENTER, 3, 10):
        assert (frame.position - CENTER)[2] == pytest.approx(4 * kept)
        assert np.linalg.norm(frame.position - CENTER) == pytest.approx(4)


def test_photos_that_have_no_common_top_are_taken_to_stand_in_a_frame_with_z_upwards() -> None:
    photos = [photo((3.0, 0.0, 4.0), (1.0, 0.0, 0.0)), photo((0.0, 3.0, 4.0), (-1.0, 0.0, 0.0))]
    frames = turntable(photos, CENTER, 2, 10)
    assert np.array([frame.position for frame in frames]) - CENTER == pytest.approx(
        np.array([[3.0, 0, 4], [-3, 0, 4]]), abs=1e-9
    )


@pytest.mark.parametrize("others", [[], [photo((0.0, 4.0, 0.0), (0.0, 0.0, 1.0))]])
def test_a_photo_from_right_above_gives_the_turntable_no_side_to_start_from(others: list[Camera]) -> None:
    above = [photo((0.0, 0.0, 4.0), (0.0, 0.0, 1.0))]
    frames = turntable([*above, *others], CENTER, 4, 10)
    offsets = np.array([frame.position - CENTER for frame in frames])
    assert np.linalg.norm(offsets, axis=1) == pytest.approx(np.full(4, 4.0))
    assert offsets[0, :2] == pytest.approx(-offsets[2, :2])
    assert np.linalg.norm(offsets[0, :2]) > 1
    assert not others or offsets[0, 1] == pytest.approx(np.linalg.norm(offsets[0, :2]))


def camera(width: int = 60, height: int = 40) -> Camera:
    """A camera of the user's frame, 9 units from the object's middle."""
    found = camera_at((6.0, 6.0, 3.0), size=height, width=width, focal=50)
    pose = found.camera_to_world.copy()
    pose[:3, 3] += SIMILARITY.center
    return dataclasses.replace(found, camera_to_world=pose)


def test_the_object_has_its_size_and_place_in_the_user_s_frame() -> None:
    """A ball of radius 2 at 9 units and a focal length of 50 pixels: its outline has the radius 50 tan(asin(2
    / 9)).
    """
    light = Environment(torch.full((6, 16, 16, 3), 0.5))
    image, cover = relight(known_decomposition(), light, camera())
    assert image.shape == (40, 60, 3)
    assert cover.shape == (40, 60)
    radius = 50 * math.tan(math.asin(2 / 9))
    assert float(cover.sum()) == pytest.approx(math.pi * radius**2, rel=0.02)
    rows, columns = np.mgrid[:40, :60] + 0.5
    assert float((cover * torch.from_numpy(columns)).sum() / cover.sum()) == pytest.approx(30, abs=0.1)
    assert float((cover * torch.from_numpy(rows)).sum() / cover.sum()) == pytest.approx(20, abs=0.1)
    assert float(image[cover == 0].abs().max()) == 0
    reddish = light.scaled(torch.tensor([3.0, 1.0, 1.0]))
    tinted, _ = Relighter(known_decomposition(), CPU).picture(reddish, camera())
    torch.testing.assert_close(tinted, image * torch.tensor([3.0, 1.0, 1.0]))


@pytest.mark.parametrize(("renderer", "rays"), [(Renderer.PATH, [77]), (Renderer.FAST, [])])
def test_the_configured_renderer_makes_the_picture(
    renderer: Renderer, rays: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, made = [], torch.full((40, 60), 0.125)

    class Traced:
        def __init__(self, asset: Asset, samples: int):
            asked.append(samples)

        def render(self, camera: Camera, light: Tensor) -> tuple[Tensor, Tensor]:
            assert camera.position == pytest.approx([3, 3, 1.5])  # of the normalised frame
            assert light.shape == (6, 16, 16, 3)
            return torch.zeros(40, 60, 3), made

    monkeypatch.setattr(relighting, "PathTracer", Traced)
    config = RenderConfig(renderer, samples=77)
    _, cover = relight(known_decomposition(), Environment(torch.ones(6, 16, 16, 3)), camera(), config)
    assert asked == rays
    assert (cover is made) == (renderer is Renderer.PATH)

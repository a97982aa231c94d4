"""The files of a located photo."""

import dataclasses
import json

import numpy as np
import pytest

from lightprobe.imaging import read_ldr, read_mask
from lightprobe.localization.located import Located
from lightprobe.localization.verdict import PoseVerdict
from lightprobe.scene.camera import Camera
from lightprobe.scene.new_photo import read_camera
from lightprobe.scene.overlay import HULL_COLOR


@pytest.fixture
def located(camera, photo):
    clipped = photo[0] > np.quantile(photo[0], 0.9)
    return Located(camera, photo[1], PoseVerdict(2.5, 0.9, 0.7, 1.0, 30, 0, 0.01), photo[0], clipped, 0.5)


def test_the_camera_is_one_that_other_commands_read(located, tmp_path):
    located.save_camera(tmp_path / "a.camera.json")
    back = read_camera(tmp_path / "a.camera.json")
    assert isinstance(back, Camera)
    assert np.allclose(back.camera_to_world, located.camera.camera_to_world)
    assert json.loads((tmp_path / "a.camera.json").read_text())["verdict"]["status"] == "good"


def test_the_mask_is_one_that_other_commands_read(located, tmp_path):
    located.save_mask(tmp_path / "a.mask.png")
    assert np.abs(read_mask(tmp_path / "a.mask.png") - located.mask).max() < 0.003


def test_the_overlay_shows_the_outline(located, tmp_path):
    located.save_overlay(tmp_path / "a.overlay.png")
    shown = np.rint(255 * read_ldr(tmp_path / "a.overlay.png", srgb=False)[0])
    marked = (shown == HULL_COLOR).all(2)
    assert 80 < marked.sum() < 800
    assert not marked[located.mask >= 0.5].any()


def test_its_pixels_are_black_outside_of_the_mask(located):
    pixels = located.pixels
    assert (pixels.color[located.mask == 0] == 0).all()
    assert pixels.alpha is located.mask


def test_the_mask_of_a_reduced_photo_is_written_at_the_photos_size(located, tmp_path):
    height, width = located.mask.shape
    large = dataclasses.replace(located, camera=located.camera.resized(3 * width, 3 * height))
    large.save_mask(tmp_path / "a.mask.png")
    written = read_mask(tmp_path / "a.mask.png")
    assert written.shape == (3 * height, 3 * width)
    assert np.abs(written.reshape(height, 3, width, 3).mean((1, 3)) - located.mask).mean() < 0.02


def test_its_pixels_are_clipped_where_the_photo_is(located):
    inside = located.mask > 0
    np.testing.assert_array_equal(located.pixels.clipped[inside], located.clipped[inside])
    assert located.pixels.clipped.any()
    assert not located.pixels.clipped[~inside].any()

"""From a photo's file to its camera."""

import dataclasses
import json

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.imaging import limits, read_ldr, read_mask, write_png
from lightprobe.localization import Locator, PoseStatus
from lightprobe.localization.locator import Located
from lightprobe.localization.pose import mean_distance
from lightprobe.localization.verdict import PoseVerdict
from lightprobe.scene.camera import Camera
from lightprobe.scene.new_photo import read_camera
from lightprobe.scene.overlay import HULL_COLOR
from tests.painted_object import SIMILARITY, decomposition, in_input_frame


@pytest.fixture
def located(camera, photo):
    clipped = photo[0] > np.quantile(photo[0], 0.9)
    return Located(camera, photo[1], PoseVerdict(2.5, 0.9, 0.7, 0.5, 1.0, 0, 0.01), photo[0], clipped, 0.5)


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


@pytest.fixture(scope="module")
def locator(asset, views):
    return Locator(decomposition(asset), views)


@pytest.fixture
def file(photo, tmp_path):
    write_png(tmp_path / "new.png", photo[0])
    return tmp_path / "new.png"


@pytest.mark.slow
def test_camera_and_mask_of_a_photo(locator, asset, camera, photo, file):
    located = locator.locate(file, focal=camera.fx)
    points = SIMILARITY.invert(asset.mesh.vertices[::20].double().numpy())
    assert mean_distance(located.camera, in_input_frame(camera), points) < 0.5
    assert np.abs(located.mask - photo[1]).mean() < 0.01
    assert located.verdict.status is PoseStatus.GOOD
    assert located.verdict.inside == 1


@pytest.mark.slow
def test_a_mask_that_is_given_stays_as_it_is(locator, camera, photo, file, tmp_path):
    write_png(tmp_path / "mask.png", np.repeat(photo[1][..., None], 3, 2), srgb=False)
    located = locator.locate(file, mask=tmp_path / "mask.png", focal=camera.fx)
    assert np.abs(located.mask - photo[1]).max() < 0.003


@pytest.mark.long
def test_a_mask_with_black_and_white_exchanged_is_told(locator, camera, photo, file, tmp_path):
    write_png(tmp_path / "mask.png", np.repeat(1 - photo[1][..., None], 3, 2), srgb=False)
    with pytest.raises(InputError, match=r"mask\.png looks inverted"):
        locator.locate(file, mask=tmp_path / "mask.png", focal=camera.fx)


@pytest.mark.long
def test_a_photo_without_the_object_is_refused_by_name(locator, tmp_path):
    grey = np.full((96, 128, 3), 0.3) + 0.2 * np.linspace(0, 1, 128)[:, None]
    write_png(tmp_path / "wall.png", grey)
    with pytest.raises(InputError, match=r"wall\.png.*(not found|nothing)"):
        locator.locate(tmp_path / "wall.png", focal=170.0)


@pytest.mark.parametrize(("level", "word"), [(0.0, "black"), (1.0, "white")])
def test_a_photo_of_nothing_is_refused(locator, tmp_path, level, word):
    write_png(tmp_path / "nothing.png", np.full((96, 128, 3), level))
    with pytest.raises(InputError, match=rf"nothing\.png is {word} all over"):
        locator.locate(tmp_path / "nothing.png", focal=170.0)


def test_a_strip_of_a_photo_is_refused(locator, tmp_path):
    write_png(tmp_path / "strip.png", np.linspace(0, 1, 36).reshape(3, 4, 3))
    with pytest.raises(InputError, match=r"strip\.png has 4 x 3 pixels"):
        locator.locate(tmp_path / "strip.png", focal=10.0)


def test_a_mask_of_another_size_is_refused(locator, file, tmp_path):
    write_png(tmp_path / "mask.png", np.ones((10, 10, 3)))
    with pytest.raises(InputError, match=r"mask\.png has 10 x 10 pixels.*128"):
        locator.locate(file, mask=tmp_path / "mask.png")


@pytest.mark.slow
def test_a_large_photo_is_worked_on_reduced_and_its_camera_fits_it(
    locator, asset, camera, photo, tmp_path, monkeypatch
):
    height, width = photo[1].shape
    write_png(tmp_path / "new.png", photo[0].repeat(2, 0).repeat(2, 1))
    monkeypatch.setattr(limits, "WORKED_PIXELS", height * width)
    located = locator.locate(tmp_path / "new.png", focal=2 * camera.fx)
    assert (located.camera.width, located.camera.height) == (2 * width, 2 * height)
    assert located.camera.fx == pytest.approx(2 * camera.fx)
    assert located.mask.shape == located.color.shape[:2] == (height, width)
    assert np.abs(located.mask - photo[1]).mean() < 0.01

"""From a photo's file to its camera."""

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.imaging import limits, write_png
from lightprobe.localization import Locator, PoseStatus
from lightprobe.localization.pose import mean_distance
from tests.painted_object import SIMILARITY, decomposition, in_input_frame


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

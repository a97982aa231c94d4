"""What a photo shows around the object, as it is read from files."""

import numpy as np
import pytest
from PIL import Image

from lightprobe.imaging import write_png
from lightprobe.scene.background import load_background
from lightprobe.scene.photo import Photo
from tests.imaging.icc_profiles import P3_PRIMARIES, icc
from tests.shapes import camera_at

CAMERA = camera_at((0, -3, 0), size=300, focal=300.0)


@pytest.fixture
def photo(tmp_path):
    color = np.full((300, 300, 3), 0.25, np.float32)
    color[:100] = 1.0
    mask = np.zeros((300, 300, 3), np.float32)
    mask[150:210, 120:180] = 1
    color[150:210, 120:180] = 0.8
    write_png(tmp_path / "photo.png", color)
    write_png(tmp_path / "mask.png", mask, srgb=False)
    return Photo("photo", CAMERA, tmp_path / "photo.png", tmp_path / "mask.png")


def test_it_is_what_lies_clear_of_the_mask(photo):
    background = load_background(photo)
    assert background is not None
    assert background.seen.shape == (256, 256)
    assert (background.camera.width, background.camera.fx) == (256, 256.0)
    inside = np.zeros((256, 256), bool)
    inside[128:180, 103:154] = True
    assert not background.seen[inside].any()
    assert background.seen[:120].all()
    np.testing.assert_allclose(background.color[background.seen][-1], 0.25, atol=0.005)
    assert not np.isclose(background.color[background.seen], 0.8, atol=0.05).any()


def test_a_mask_that_is_not_quite_black_hides_no_background(photo):
    clear = load_background(photo)
    with Image.open(photo.mask_path) as mask:
        hazy = np.maximum(np.asarray(mask), 3)
    Image.fromarray(hazy).save(photo.mask_path)
    assert np.array_equal(load_background(photo).seen, clear.seen)


def test_white_is_a_lower_bound(photo):
    background = load_background(photo)
    assert background is not None
    assert background.clipped[:80].all()
    assert not background.clipped[90:].any()


def test_one_colour_beyond_srgb_hides_no_white(photo):
    samples = np.full((300, 300, 3), 140, np.uint8)
    samples[:100], samples[290:, 290:] = 255, (255, 200, 150)
    Image.fromarray(samples).save(photo.image_path, icc_profile=icc("Wide Thing", P3_PRIMARIES, 2.2))
    background = load_background(photo)
    assert background is not None
    assert background.color.max() > 1.02
    assert background.clipped[:80].all()
    assert not background.clipped[90:240].any()


def test_a_cut_out_has_none(photo, tmp_path):
    write_png(tmp_path / "cut.png", np.ones((300, 300, 3), np.float32), np.full((300, 300), 0.5, np.float32))
    assert load_background(Photo("cut", CAMERA, tmp_path / "cut.png")) is None
    assert load_background(Photo("cut", CAMERA, tmp_path / "cut.png", photo.mask_path)) is None

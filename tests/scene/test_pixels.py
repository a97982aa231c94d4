"""A photo's pixels at smaller sizes: which of them hide how bright the object was."""

import numpy as np
import pytest
from PIL import Image

from lightprobe.imaging import limits, write_mask, write_png
from lightprobe.scene import Pixels, load_pixels
from lightprobe.scene.background import load_background
from lightprobe.scene.photo import Photo
from lightprobe.scene.pixels import load_observed
from tests.imaging.icc_profiles import P3_PRIMARIES, icc
from tests.shapes import camera_at

CAMERA = camera_at((0, -3, 0), size=300, focal=300.0)


def grey(height=8, width=8):
    return np.full((height, width, 3), 0.2, np.float32), np.ones((height, width), np.float32)


def test_one_clipped_pixel_marks_what_it_is_averaged_into():
    color, alpha = grey()
    color[2, 5] = (1.0, 0.99, 0.3)
    pixels = Pixels.of(color, alpha)
    assert pixels.clipped.sum() == 2
    small = pixels.resized(2, 2)
    expected = np.zeros((2, 2, 3), bool)
    expected[0, 1, :2] = True
    assert np.array_equal(small.clipped, expected)
    assert small.color.max() < 0.3  # the average alone would not tell


def test_a_second_reduction_keeps_the_marks():
    color, alpha = grey(16, 16)
    color[9, 3] = 1.0
    small = Pixels.of(color, alpha).resized(8, 8).resized(2, 2)
    assert np.array_equal(small.clipped[..., 0], [[False, False], [True, False]])


def test_what_lies_outside_the_mask_marks_nothing():
    color, alpha = grey()
    color[:4], alpha[:4] = 1.0, 0.0
    assert not Pixels.of(color, alpha).resized(4, 4).clipped.any()


def test_a_linear_photo_has_no_white_to_clip_at():
    color, alpha = grey()
    color[0, 0] = 30.0
    color[0, 1] = 1.0
    assert not Pixels.of(color, alpha).clipped.any()


@pytest.mark.parametrize(("side", "share"), [(None, 1 / 64), (2, 1 / 4)])
def test_a_decoded_photo_carries_its_marks(tmp_path, side, share):
    color, alpha = grey()
    color[5, 6] = 1.0
    write_png(tmp_path / "a.png", color, alpha)
    pixels, camera = load_pixels(Photo("a", camera_at((3, 0, 0), size=8), tmp_path / "a.png"), side)
    assert pixels.clipped.mean() == share
    assert pixels.clipped.shape[:2] == (camera.height, camera.width)


def discs(folder, size, alpha_radius):
    """Write a photo with a disc, and its mask as a file of its own; return both photos."""
    height, width = size
    row, column = np.mgrid[:height, :width]
    alpha = (np.hypot(row - height / 2, column - width / 2) < alpha_radius).astype(np.float32)
    color = np.dstack([row / height, column / width, np.ones(size)]).astype(np.float32)
    write_png(folder / "cut.png", color, alpha)
    write_png(folder / "whole.png", color)
    write_mask(folder / "mask.png", alpha)
    camera = camera_at((3, 0, 0), size=8).resized(width, height)
    return [
        Photo("cut", camera, folder / "cut.png"),
        Photo("whole", camera, folder / "whole.png", folder / "mask.png"),
    ]


@pytest.mark.parametrize("most", [100, 1000, 10**6])
def test_what_a_prediction_reads_is_the_whole_photo_reduced(tmp_path, most):
    for photo in discs(tmp_path, (90, 120), 40):
        pixels, camera = load_observed(photo, most)
        expected = load_pixels(photo)[0].within(most)
        assert (camera.height, camera.width) == pixels.alpha.shape == expected.alpha.shape
        assert (pixels.alpha.shape == (90, 120)) == (most > 5000)
        for part in ("color", "alpha", "clipped"):
            np.testing.assert_array_equal(getattr(pixels, part), getattr(expected, part))


def test_a_large_photo_of_a_small_object_is_not_held_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "WORKED_PIXELS", 3000)
    for photo in discs(tmp_path, (90, 120), 10):
        pixels, camera = load_observed(photo, 10**6)
        assert pixels.alpha.shape == (camera.height, camera.width) == (47, 63)
        assert pixels.alpha.sum() == pytest.approx(np.pi * 100 * 3000 / (90 * 120), rel=0.05)


@pytest.fixture
def background_photo(tmp_path):
    color = np.full((300, 300, 3), 0.25, np.float32)
    color[:100] = 1.0
    mask = np.zeros((300, 300, 3), np.float32)
    mask[150:210, 120:180] = 1
    color[150:210, 120:180] = 0.8
    write_png(tmp_path / "background_photo.png", color)
    write_png(tmp_path / "mask.png", mask, srgb=False)
    return Photo("background_photo", CAMERA, tmp_path / "background_photo.png", tmp_path / "mask.png")


def test_it_is_what_lies_clear_of_the_mask(background_photo):
    background = load_background(background_photo)
    assert background is not None
    assert background.seen.shape == (256, 256)
    assert (background.camera.width, background.camera.fx) == (256, 256.0)
    inside = np.zeros((256, 256), bool)
    inside[128:180, 103:154] = True
    assert not background.seen[inside].any()
    assert background.seen[:120].all()
    np.testing.assert_allclose(background.color[background.seen][-1], 0.25, atol=0.005)
    assert not np.isclose(background.color[background.seen], 0.8, atol=0.05).any()


def test_a_mask_that_is_not_quite_black_hides_no_background(background_photo):
    clear = load_background(background_photo)
    with Image.open(background_photo.mask_path) as mask:
        hazy = np.maximum(np.asarray(mask), 3)
    Image.fromarray(hazy).save(background_photo.mask_path)
    assert np.array_equal(load_background(background_photo).seen, clear.seen)


def test_white_is_a_lower_bound(background_photo):
    background = load_background(background_photo)
    assert background is not None
    assert background.clipped[:80].all()
    assert not background.clipped[90:].any()


def test_one_colour_beyond_srgb_hides_no_white(background_photo):
    samples = np.full((300, 300, 3), 140, np.uint8)
    samples[:100], samples[290:, 290:] = 255, (255, 200, 150)
    Image.fromarray(samples).save(
        background_photo.image_path, icc_profile=icc("Wide Thing", P3_PRIMARIES, 2.2)
    )
    background = load_background(background_photo)
    assert background is not None
    assert background.color.max() > 1.02
    assert background.clipped[:80].all()
    assert not background.clipped[90:240].any()


def test_a_cut_out_has_none(background_photo, tmp_path):
    write_png(tmp_path / "cut.png", np.ones((300, 300, 3), np.float32), np.full((300, 300), 0.5, np.float32))
    assert load_background(Photo("cut", CAMERA, tmp_path / "cut.png")) is None
    assert load_background(Photo("cut", CAMERA, tmp_path / "cut.png", background_photo.mask_path)) is None

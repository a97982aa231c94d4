"""A photo's pixels at smaller sizes: which of them hide how bright the object was."""

import numpy as np
import pytest

from lightprobe.imaging import limits, write_mask, write_png
from lightprobe.scene import Pixels, load_pixels
from lightprobe.scene.photo import Photo
from lightprobe.scene.pixels import load_observed
from tests.shapes import camera_at


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

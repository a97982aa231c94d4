"""A photo's pixels at smaller sizes: which of them hide how bright the object was."""

import numpy as np
import pytest

from lightprobe.imaging import write_png
from lightprobe.scene import Pixels, load_pixels
from lightprobe.scene.photo import Photo
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

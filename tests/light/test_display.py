"""Maps for the eye: how bright they are shown, how highlights bend, and what stands in the picture's bytes."""

import io
import math

import numpy as np
import pytest
from PIL import Image

from lightprobe.light.display import displayed, exposure, png, tone_mapped


def grey(*levels: float) -> np.ndarray:
    """Return a picture (1, n, 3) of grey texels."""
    return np.repeat(np.array([levels], np.float32)[..., None], 3, 2)


@pytest.mark.parametrize(
    ("image", "factor"),
    [
        (grey(1, 2, 3, 4, 100), 0.5 / 5),  # the sun counts as five times the median, 15
        (grey(1, 2, 3, 4, 15), 0.5 / 5),
        (grey(1, 2, 3, 4, 10), 0.5 / 4),
        (np.array([[[2.0, 0, 0]]]), 0.5 / 0.4252),
        (np.array([[[0.0, 0.5, 3.0]]]), 0.5 / (0.3576 + 0.2166)),
        (grey(0, 0, 0, 7), 0.5 / 1.75),  # nothing but a lamp: the black around it is no typical luma
        (grey(0, 0), 1.0),
    ],
)
def test_half_of_the_typical_luma_is_what_a_picture_is_exposed_to(image: np.ndarray, factor: float) -> None:
    assert exposure(image) == pytest.approx(factor, rel=1e-5)


def test_highlights_bend_towards_one() -> None:
    found = tone_mapped(np.array([-3.0, 0.0, 0.25, 0.5, 50.0]), 2.0)
    assert found == pytest.approx([0, 0, 1 - math.exp(-0.5), 1 - math.exp(-1), 1], abs=1e-9)


def test_a_grey_map_is_shown_at_the_same_brightness_whatever_its_radiance() -> None:
    encoded = 1.055 * (1 - math.exp(-0.5)) ** (1 / 2.4) - 0.055
    for level in (0.003, 40.0):
        assert displayed(grey(level, level, level)) == pytest.approx(np.full((1, 3, 3), encoded), rel=1e-5)


def test_a_png_holds_rounded_bytes_cut_at_black_and_white() -> None:
    encoded = np.array(
        [[[0.0, 1.0, 0.5], [-1.0, 2.0, 127.4 / 255]], [[127.6 / 255, 1 / 255, 254 / 255], [0, 0, 1]]]
    )
    data = png(encoded)
    assert data.startswith(b"\x89PNG")
    picture = np.asarray(Image.open(io.BytesIO(data)))
    assert picture.tolist() == [[[0, 255, 128], [0, 255, 127]], [[128, 1, 254], [0, 0, 255]]]

"""The focal length in a photo's EXIF."""

import numpy as np
import pytest
from PIL import Image

from lightprobe.localization.focal import focal_ratio


@pytest.mark.parametrize(("value", "expected"), [(28, 28 / 36), (0, None), (5000, None)])
def test_the_equivalent_of_film(tmp_path, value, expected):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = value
    Image.fromarray(np.zeros((20, 30, 3), np.uint8)).save(tmp_path / "a.jpg", exif=exif)  # 3:2, as film
    found = focal_ratio(tmp_path / "a.jpg")
    assert found == (expected if expected is None else pytest.approx(expected))


def test_none_in_a_plain_photo(tmp_path):
    Image.fromarray(np.zeros((20, 30, 3), np.uint8)).save(tmp_path / "a.png")
    assert focal_ratio(tmp_path / "a.png") is None

import numpy as np
import pytest

from lightprobe.imaging import resize, resize_area, resize_rows

RNG = np.random.default_rng(7)


def test_integer_ratio_is_block_mean():
    image = RNG.random((12, 20, 3)).astype(np.float32)
    expected = image.reshape(4, 3, 5, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(resize_area(image, 4, 5), expected, atol=1e-6)


@pytest.mark.parametrize("size", [(7, 11), (5, 3), (1, 1), (10, 16)])
def test_any_ratio_agrees_with_subdivided_pixels_and_keeps_the_mean(size):
    image = RNG.random((10, 16)).astype(np.float32)
    fine = np.kron(
        image, np.ones((size[0], size[1]))
    )  # every pixel cut so that output edges fall between the parts
    expected = fine.reshape(size[0], 10, size[1], 16).mean(axis=(1, 3))
    small = resize_area(image, *size)
    np.testing.assert_allclose(small, expected, atol=1e-6)
    assert small.dtype == np.float32
    assert small.mean() == pytest.approx(image.mean(), abs=1e-6)


@pytest.mark.parametrize("size", [(7, 11), (40, 16), (1, 1), (13, 64)])
@pytest.mark.parametrize("channels", [(), (4,)])
def test_rows_at_a_time_give_the_same_bits(monkeypatch, size, channels):
    image = RNG.random((40, 64, *channels)).astype(np.float32)
    whole = resize_area(image, *size)
    asked = []

    def read(first, last):
        asked.append(last - first)
        return image[first:last]

    monkeypatch.setattr(resize, "STRIP", 64 * 5)
    np.testing.assert_array_equal(resize_rows(read, image.shape, *size), whole)
    assert max(asked) <= max(7, -(-40 // size[0]))

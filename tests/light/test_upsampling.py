import tracemalloc

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.imaging import read_hdr, resize_area, write_exr, write_radiance
from lightprobe.light import equirect
from lightprobe.light.upsampling import HEIGHTS, map_height, resized_map


def lit_map(rows: int = 64) -> np.ndarray:
    """A sky with a texel-sized sun of ten thousand times its level, a black wall and a lamp across the seam."""
    direction = equirect.directions(rows).numpy()
    sky = 0.3 + 0.2 * direction[..., 2:] + 0.1 * direction[..., :1]
    image = np.repeat(sky, 3, 2) * [0.8, 1.0, 1.3]
    image[rows // 4, rows // 3] = 3000.0
    image[rows // 2 : rows // 2 + 6, 20:40] = 0.0
    image[rows // 3, [0, -1]] = 40.0
    return image.astype(np.float32)


def block_means(image: np.ndarray, rows: int) -> np.ndarray:
    k = image.shape[0] // rows
    return image.astype(np.float64).reshape(rows, k, 2 * rows, k, 3).mean((1, 3))


@pytest.mark.slow
@pytest.mark.parametrize("height", [128, 512, 1024])
def test_a_larger_map_averages_back_to_the_map(height):
    image = lit_map()
    large = resized_map(image, height)
    assert large.shape == (height, 2 * height, 3)
    assert large.dtype == np.float32
    assert large.min() >= 0
    assert np.abs(block_means(large, 64) - image).max() < 1e-3 * image.max() * 1e-3
    assert np.allclose(block_means(large, 64), image, rtol=1e-4, atol=1e-9)
    assert np.allclose(resize_area(large, 64, 128), image, rtol=1e-3, atol=1e-6)


@pytest.mark.slow
def test_the_light_of_the_whole_sphere_is_kept():
    image = lit_map()
    flux = [
        (part * equirect.solid_angles(len(part)).numpy()[..., None]).sum((0, 1), dtype=np.float64)
        for part in (image, resized_map(image, 1024))
    ]
    assert np.allclose(*flux, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("turn", [64, 37])
def test_the_seam_is_no_different_from_any_other_column(turn):
    image = lit_map()
    large = resized_map(image, 256)
    assert np.allclose(
        np.roll(resized_map(np.roll(image, turn, 1), 256), -4 * turn, 1), large, rtol=1e-4, atol=1e-7
    )


def test_a_smooth_light_stays_smooth_across_seam_and_poles():
    direction = equirect.directions(64).numpy()
    image = np.exp(direction @ np.array([[0.9, 0.2, 0.1], [0.5, 0.8, 0.3], [0.4, 0.6, 0.7]])).astype(
        np.float32
    )
    true = np.exp(
        equirect.directions(512).numpy() @ np.array([[0.9, 0.2, 0.1], [0.5, 0.8, 0.3], [0.4, 0.6, 0.7]])
    )
    large = resized_map(image, 512)
    assert np.abs(large / true - 1).max() < 2e-3
    over_the_pole = np.roll(large[0], 512, 0)
    assert np.abs(large[0] / over_the_pole - 1).max() < 0.02  # half a texel of 512 away


@pytest.mark.slow
def test_a_sun_is_smooth_and_darkens_only_its_neighbours():
    """Texels beside a sun of a thousand times their level keep their means, so that their far halves get
    darker.
    """
    image = np.full((64, 128, 3), 0.5, np.float32)
    image[20, 40] = 500.0
    large = resized_map(image, 1024)
    assert large.min() > 0
    assert np.allclose(large[20 * 16 + 96 :], 0.5, rtol=0.2)
    assert np.allclose(large[:, 40 * 16 + 112 :], 0.5, rtol=0.2)
    steps = np.abs(np.diff(np.log(large[..., 0]), axis=0))
    assert steps.max() < 1.5  # 7 e-folds are crossed within a texel of 16 rows


def test_smaller_maps_are_means_by_solid_angle():
    image, angle = lit_map(256), equirect.solid_angles(256).double().numpy()[..., None].repeat(3, 2)
    expected = block_means(image * angle, 64) / block_means(angle, 64)
    assert np.allclose(resized_map(image, 64), expected, rtol=1e-5)
    assert np.array_equal(resized_map(image, 256), image)


@pytest.mark.parametrize("row", [0, 3, 40])
def test_a_sun_keeps_its_flux_in_a_smaller_map(row):
    image = np.zeros((256, 512, 3), np.float32)
    image[row, 17] = 1000.0
    flux = [
        (part[..., 0] * equirect.solid_angles(len(part)).numpy()).sum()
        for part in (image, resized_map(image, 64))
    ]
    assert flux[1] == pytest.approx(flux[0], rel=1e-3)


def test_a_map_of_an_odd_size_keeps_its_mean():
    image = lit_map(60)
    assert np.allclose(resized_map(image, 256).mean((0, 1)), image.mean((0, 1)), rtol=1e-4)


@pytest.mark.parametrize("values", [0.0, 2.0])
def test_constant_maps_stay_constant(values):
    assert np.allclose(resized_map(np.full((64, 128, 3), values, np.float32), 128), values, rtol=1e-6)


def test_sizes_are_read():
    assert [map_height(f"{2 * rows}x{rows}") for rows in HEIGHTS] == list(HEIGHTS)
    assert [map_height(str(2 * rows)) for rows in HEIGHTS] == list(HEIGHTS)


@pytest.mark.parametrize(
    "size", ["", "100", "2048x2048", "64x32", "8192x4096", "-128x64", "1e3", "128x64x3", "384"]
)
def test_other_sizes_are_one_sentence(size):
    with pytest.raises(ConfigError, match=r"cannot have the --size .*128x64, 256x128.*4096x2048"):
        map_height(size)


@pytest.mark.slow
def test_both_formats_read_back(tmp_path):
    large = resized_map(lit_map(), 256)
    for name, write in (("a.exr", write_exr), ("a.hdr", write_radiance)):
        write(tmp_path / name, large)
    exact, rough = read_hdr(tmp_path / "a.exr"), read_hdr(tmp_path / "a.hdr")
    assert np.array_equal(exact, large)
    assert (
        np.abs(rough - large) <= (1 / 256) * large.max(-1, keepdims=True)
    ).all()  # eight bits of a mantissa
    import OpenEXR

    assert np.array_equal(OpenEXR.File(str(tmp_path / "a.exr")).channels()["RGB"].pixels, large)


@pytest.mark.long
def test_the_largest_map_needs_little_memory(tmp_path):
    image = lit_map()
    tracemalloc.start()
    try:
        large = resized_map(image, 2048)
        assert tracemalloc.get_traced_memory()[1] < 1.5 * large.nbytes
        tracemalloc.reset_peak()
        write_radiance(tmp_path / "a.hdr", large)
        assert tracemalloc.get_traced_memory()[1] < 2.0 * large.nbytes
    finally:
        tracemalloc.stop()
    assert np.allclose(block_means(large, 64), image, rtol=1e-4, atol=1e-9)
    assert read_hdr(tmp_path / "a.hdr").shape == large.shape

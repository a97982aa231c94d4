"""Maps at other sizes: a spline of the logarithm around the seam and over the poles; texel means are kept."""

import numpy as np
import pytest
from numpy.polynomial import polynomial

from lightprobe.core.errors import ConfigError
from lightprobe.imaging import resize_area
from lightprobe.light import equirect, upsampling
from lightprobe.light.upsampling import HEIGHTS, map_height, resized_map


def some_map(rows: int) -> np.ndarray:
    """Return a map of three channels, the last of them black, with a factor of 20 between neighbours."""
    random = np.exp(np.random.default_rng(rows).uniform(-1.5, 1.5, (rows, 2 * rows, 3)))
    return (random * [1.0, 300.0, 0.0]).astype(np.float32)


def ends(large: np.ndarray, texels: int) -> tuple[np.ndarray, np.ndarray]:
    """Return values and slopes (2, texels, n) of the logarithm of `large` (k texels, n) where texels begin and end.

    They belong to the parabola through a texel's samples from the top, which all must lie on it.
    """
    log = np.log(large.astype(np.float64)).reshape(texels, -1, large.shape[1]).transpose(1, 0, 2)
    places = (np.arange(len(log)) + 0.5) / len(log) - 0.5
    fit = polynomial.polyfit(places, log.reshape(len(log), -1), 2)
    assert np.abs(polynomial.polyval(places, fit) - log.reshape(len(log), -1).T).max() < 2e-6
    curves = (fit, polynomial.polyder(fit))
    at, shape = np.array([-0.5, 0.5]), (2, *log.shape[1:])
    values, slopes = (polynomial.polyval(at, curve).T.reshape(shape) for curve in curves)
    return values, slopes


@pytest.mark.parametrize("factor", [5, 8, 16])
@pytest.mark.parametrize("channel", [0, 1])
def test_the_logarithm_is_a_parabola_in_each_texel_and_smooth_from_one_to_the_next(
    factor: int, channel: int
) -> None:
    large = resized_map(some_map(6), 6 * factor)[..., channel]
    half = 6 * factor  # columns of half a turn
    for ended in ends(large, 6):
        assert np.abs(ended[0, 1:] - ended[1, :-1]).max() < 0.01
    for ended in ends(large.T, 12):
        assert np.abs(np.roll(ended[0], -1, 0) - ended[1]).max() < 0.01
    for ended, sign in zip(ends(large, 6), (1, -1), strict=True):  # over a pole the way goes back
        for pole in (ended[0, 0], ended[1, -1]):
            assert np.abs(pole - sign * np.roll(pole, half)).max() < 0.01


@pytest.mark.parametrize("factor", [2, 3, 16])
def test_texels_keep_their_means_and_a_black_channel_stays_black(factor: int) -> None:
    image = some_map(4)
    image[1, 2] = 0
    large = resized_map(image, 4 * factor).astype(np.float64)
    assert large.shape == (4 * factor, 8 * factor, 3)
    means = large.reshape(4, factor, 8, factor, 3).mean((1, 3))
    assert means == pytest.approx(image, rel=1e-5)
    assert large[factor : 2 * factor, 2 * factor : 3 * factor].max() == 0


def test_a_map_is_the_same_however_many_rows_are_magnified_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    image = some_map(6)
    whole = resized_map(image, 24)
    for rows in (4, 1, 0.1):
        monkeypatch.setattr(upsampling, "_AT_ONCE", int(rows * 12 * 4**2))
        assert np.array_equal(resized_map(image, 24), whole)


@pytest.mark.parametrize(("rows", "between", "height"), [(5, 8, 32), (5, 6, 24), (6, 7, 14), (3, 4, 16)])
def test_a_map_whose_rows_do_not_divide_goes_through_the_next_finer_one(
    rows: int, between: int, height: int
) -> None:
    image = some_map(rows)
    expected = resized_map(resize_area(image, between, 2 * between), height)
    assert np.array_equal(resized_map(image, height), expected)


def test_a_map_of_the_size_that_is_wanted_is_that_map_and_a_smaller_one_is_its_means_by_solid_angle() -> None:
    image = some_map(4).astype(np.float64)
    same = resized_map(image, 4)
    assert same.dtype == np.float32
    assert np.array_equal(same, image.astype(np.float32))
    angle = np.broadcast_to(equirect.solid_angles(4).double().numpy()[..., None], image.shape)
    flux, whole = (part.reshape(2, 2, 4, 2, 3).sum((1, 3)) for part in (image * angle, angle))
    assert resized_map(image, 2) == pytest.approx(flux / whole, rel=1e-6)
    assert resized_map(image, 3).shape == (3, 6, 3)


def test_sizes_are_powers_of_two_in_any_spelling() -> None:
    assert HEIGHTS == (64, 128, 256, 512, 1024, 2048)
    assert [map_height(size) for size in (" 512X256\n", "512", "4096x2048", "128")] == [256, 256, 2048, 64]


@pytest.mark.parametrize(
    "size", ["129", "127", "512x255", "511x256", "256x256", "64", "000512", "512x", "x256", "9" * 60]
)
def test_a_size_that_is_none_is_named_in_forty_letters_at_most(size: str) -> None:
    with pytest.raises(ConfigError) as caught:
        map_height(size)
    assert str(caught.value) == (
        f"A map cannot have the --size '{size[:40]}'; give one of 128x64, 256x128, 512x256, 1024x512, 2048x1024, "
        "4096x2048, or only its width."
    )


def lit_map(rows: int = 64) -> np.ndarray:
    """A sky with a texel-sized sun of ten thousand times its level, a black wall and a lamp across the seam."""
    direction = equirect.directions(rows).numpy()
    sky = 0.3 + 0.2 * direction[..., 2:] + 0.1 * direction[..., :1]
    image = np.repeat(sky, 3, 2) * [0.8, 1.0, 1.3]
    image[rows // 4, rows // 3] = 3000.0
    image[rows // 2 : rows // 2 + 6, 20:40] = 0.0
    image[rows // 3, [0, -1]] = 40.0
    return image.astype(np.float32)


def test_a_smooth_light_stays_smooth_across_seam_and_poles():
    direction = equirect.directions(64).numpy()
    slopes = np.array([[0.9, 0.2, 0.1], [0.5, 0.8, 0.3], [0.4, 0.6, 0.7]])
    image = np.exp(direction @ slopes).astype(np.float32)
    true = np.exp(equirect.directions(512).numpy() @ slopes)
    large = resized_map(image, 512)
    assert np.abs(large / true - 1).max() < 2e-3
    over_the_pole = np.roll(large[0], 512, 0)
    assert np.abs(large[0] / over_the_pole - 1).max() < 0.02  # half a texel of 512 away


@pytest.mark.parametrize("row", [0, 3, 40])
def test_a_sun_keeps_its_flux_in_a_smaller_map(row):
    image = np.zeros((256, 512, 3), np.float32)
    image[row, 17] = 1000.0
    pair = image[..., 0], resized_map(image, 64)[..., 0]
    before, after = ((part * equirect.solid_angles(len(part)).numpy()).sum() for part in pair)
    assert after == pytest.approx(before, rel=1e-3)


def test_a_map_of_an_odd_size_keeps_its_mean():
    image = lit_map(60)
    assert np.allclose(resized_map(image, 256).mean((0, 1)), image.mean((0, 1)), rtol=1e-4)

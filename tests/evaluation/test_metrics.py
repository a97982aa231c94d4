import math

import numpy as np
import pytest
import torch
from scipy.ndimage import correlate1d

from lightprobe.evaluation import metrics
from lightprobe.evaluation.metrics import (
    aligned,
    brightest,
    channel_scale,
    environment_log_rmse,
    image_scores,
    interval,
    log_difference,
    mean_angle,
    on_white,
    photo_interval,
    psnr,
)
from lightprobe.light import cubemap


def picture(seed: int, height: int = 40, width: int = 52) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    smooth = correlate1d(
        correlate1d(rng.random((height, width, 3)), np.ones(5) / 5, axis=0), np.ones(5) / 5, axis=1
    )
    return torch.from_numpy(smooth.astype(np.float32))


def reference_ssim(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """SSIM map by Wang et al. 2004, equation 13: window 11 x 11, sigma 1.5, K1 = .01, K2 = .03, mirrored
    border.
    """
    x = np.arange(-5, 6)
    window = np.exp(-(x**2) / (2 * 1.5**2))
    window /= window.sum()

    def blur(values):
        return correlate1d(correlate1d(values, window, axis=0, mode="mirror"), window, axis=1, mode="mirror")

    mu_a, mu_b = blur(a), blur(b)
    var_a, var_b, cov = blur(a * a) - mu_a**2, blur(b * b) - mu_b**2, blur(a * b) - mu_a * mu_b
    c1, c2 = 0.01**2, 0.03**2
    return ((2 * mu_a * mu_b + c1) * (2 * cov + c2) / ((mu_a**2 + mu_b**2 + c1) * (var_a + var_b + c2))).mean(
        -1
    )


def test_large_images_are_compared_in_bands(monkeypatch):
    a, b = picture(1), picture(2)
    inside = torch.zeros(40, 52, dtype=torch.bool)
    inside[7:33, 5:40] = True
    whole = image_scores(a, b, inside).to_json()
    monkeypatch.setattr(metrics, "_WHOLE", 100)
    monkeypatch.setattr(metrics, "_BAND", 52 * 3)
    assert image_scores(a, b, inside).to_json() == pytest.approx(whole, abs=1e-5)


def test_a_strip_narrower_than_half_the_window_has_no_ssim():
    image = torch.rand(5, 64, 3, generator=torch.Generator().manual_seed(0))
    scores = image_scores(image, image, torch.ones(5, 64, dtype=torch.bool))
    assert math.isnan(scores.ssim)
    assert scores.psnr_masked == 100


def test_psnr_and_ssim_against_their_formulas():
    a, b = picture(0), (picture(0) + 0.2 * picture(1)).clamp(0, 1)
    mask = torch.zeros(40, 52, dtype=torch.bool)
    mask[8:30, 3:20] = True
    scores = image_scores(a, b, mask)
    x, y = a.numpy().astype(np.float64), b.numpy().astype(np.float64)
    ssim = reference_ssim(x, y)
    assert scores.psnr == pytest.approx(-10 * math.log10(((x - y) ** 2).mean()), abs=1e-3)
    assert scores.ssim == pytest.approx(ssim.mean(), abs=1e-4)
    inside = mask.numpy()
    assert scores.psnr_masked == pytest.approx(-10 * math.log10(((x - y)[inside] ** 2).mean()), abs=1e-3)
    assert scores.ssim_masked == pytest.approx(ssim[inside].mean(), abs=1e-4)


def test_equal_pictures_score_100_db_and_1():
    scores = image_scores(picture(0), picture(0), torch.ones(40, 52, dtype=torch.bool))
    assert scores.to_json() == pytest.approx({"psnr": 100, "ssim": 1, "psnr_masked": 100, "ssim_masked": 1})


def test_a_uniform_error_of_a_tenth_is_20_db():
    assert psnr(torch.full((7, 3), 0.6), torch.full((7, 3), 0.5)) == pytest.approx(20, abs=1e-4)
    assert math.isnan(psnr(torch.zeros(0, 3), torch.zeros(0, 3)))


@pytest.mark.golden
def test_white_is_composited_in_linear_light():
    """Half-covered black over white is linear .5, which sRGB encodes as .735357; premultiplied .2 adds to it."""
    image = on_white(torch.tensor([[[0.0, 0.2, 0.9]]]), torch.tensor([[0.5]]))
    assert image[0, 0].tolist() == pytest.approx([0.735357, 0.854306, 1.0], abs=1e-5)


def test_channel_scale_is_not_led_by_highlights_nobody_sees():
    values = 0.4 * torch.rand(100, 1, generator=torch.Generator().manual_seed(0))
    reference = 1.5 * values
    reference[:3] = 900.0
    assert channel_scale(values, reference).item() == pytest.approx(1.5, rel=0.1)


def test_environment_error_weighs_directions_by_solid_angle_and_confidence():
    truth, wrong = torch.ones(6, 4, 4, 3), torch.ones(6, 4, 4, 3)
    wrong[2, 0, 0] = 0.0
    difference = log_difference(wrong, truth)
    solid = cubemap.solid_angles(4)
    expected = math.log(0.01 / 1.01) ** 2 * float(solid[2, 0, 0]) / (4 * math.pi)
    assert environment_log_rmse(difference) == pytest.approx(math.sqrt(expected), rel=1e-4)
    blind = torch.ones(6, 4, 4)
    blind[2, 0, 0] = 0
    assert environment_log_rmse(difference, blind) == 0


@pytest.mark.golden
def test_interval_of_a_mean():
    """t(.975, 3) = 3.18245; the standard deviation of 1 2 3 4 is 1.29099."""
    assert interval([1.0, 2.0, 3.0, 4.0]) == pytest.approx(3.18245 * 1.29099 / 2, rel=1e-5)
    assert math.isnan(interval([1.0]))


def test_mean_angle_of_unnormalised_vectors():
    a = np.array([[2.0, 0, 0], [0, 0, 1]])
    b = np.array([[0, 3.0, 0], [0, 1, 1]])
    assert mean_angle(a, b) == pytest.approx((90 + 45) / 2)


def test_the_brightest_texels_fill_their_share_of_the_sphere_and_no_map_is_without_them():
    order = torch.rand(6, 32, 32, 1, generator=torch.Generator().manual_seed(1)).expand(-1, -1, -1, 3)
    chosen, solid = brightest(order), cubemap.solid_angles(32)
    assert float(solid[chosen].sum()) == pytest.approx(0.01 * 4 * math.pi, rel=0.03)
    assert order[chosen].min() > order[~chosen].max()
    assert int(brightest(torch.ones(6, 2, 2, 3)).sum()) == 1


def test_values_of_one_group_are_one_piece_of_evidence():
    """Every value twice, and each pair a group: the interval is that of the single values."""
    single, twice = [1.0, 2.0, 4.0], [1.0, 1.0, 2.0, 2.0, 4.0, 4.0]
    assert interval(twice, [str(int(v)) for v in twice]) == pytest.approx(interval(single))
    assert interval(twice) < 0.7 * interval(single)
    assert math.isnan(interval(twice, ["one"] * 6))
    uneven = interval([1.0, 3.0, 3.0, 3.0], ["a", "b", "b", "b"])  # mean 2.5; shares -1.5 / 4 and +1.5 / 4
    assert uneven == pytest.approx(12.7062 * 2 * 0.375, rel=1e-4)


def test_photos_without_a_named_light_are_a_group_each():
    values = {"a": 1.0, "b": 2.0, "c": 4.0}
    assert photo_interval(values, {}) == pytest.approx(interval([1.0, 2.0, 4.0]))
    assert photo_interval(values, {"a": "sky", "b": "sky"}) == pytest.approx(
        interval([1.0, 2.0, 4.0], ["x", "x", "y"])
    )
    assert photo_interval({"a": 1.0, "b": 2.0}, {"a": "b"}) == pytest.approx(interval([1.0, 2.0]))


@pytest.mark.parametrize(
    ("difference", "decibels"), [(1e-2, 40), (1.1e-5, 99.1721), (0.9e-5, 100), (0.0, 100)]
)
def test_psnr_ends_at_100_db(difference: float, decibels: float) -> None:
    values = torch.tensor([[0.25, 0.5], [0.75, 0.125]], dtype=torch.float64)
    assert psnr(values - difference, values) == pytest.approx(decibels, abs=1e-3)


def test_a_picture_without_the_object_has_scores_of_the_whole_frame_alone() -> None:
    scores = image_scores(picture(0), (picture(0) + 0.1), torch.zeros(40, 52, dtype=torch.bool))
    assert scores.psnr == pytest.approx(20, abs=1e-3)
    assert 0.5 < scores.ssim < 1
    assert math.isnan(scores.psnr_masked)
    assert math.isnan(scores.ssim_masked)


@pytest.mark.parametrize("factor", [16.0, 2.0**3.3, 1.0, 2.0**-3.6, 1 / 16])
def test_channel_scale_finds_factors_from_a_sixteenth_to_sixteen(factor: float) -> None:
    values = torch.tensor([[0.01], [0.03], [0.05]]) / max(factor / 16, 1 / 16)
    assert channel_scale(values, factor * values).item() == pytest.approx(factor, rel=1e-3)


@pytest.mark.parametrize(("wanted", "low", "high"), [(45.0, 16, 23), (1 / 45, 1 / 23, 1 / 16)])
def test_channel_scale_looks_no_farther(wanted: float, low: float, high: float) -> None:
    values = torch.tensor([[0.002], [0.01], [0.02]]) * (1 if wanted > 1 else 50)
    assert low <= channel_scale(values, wanted * values).item() <= high


def test_channel_scale_counts_all_that_is_brighter_than_white_as_white() -> None:
    """The two values beyond white are matched by any factor from 1/4, the others by one of .4."""
    values = torch.tensor([[4.0], [5.0], [0.5], [0.1]])
    reference = torch.tensor([[1.0], [70.0], [0.2], [0.04]])
    assert channel_scale(values, reference).item() == pytest.approx(0.4, rel=1e-3)


def test_the_floor_of_a_log_difference_is_a_percent_of_the_mean_by_solid_angle() -> None:
    """Two of six faces are lit, so the mean over all and the three channels is (4 + 1 + 1) / 9."""
    truth = torch.zeros(6, 4, 4, 3)
    truth[:2] = torch.tensor([4.0, 1.0, 1.0])
    environment = torch.zeros(6, 4, 4, 3)
    environment[0], environment[2], environment[3] = 2.0, -1.0, 0.5
    floor, found = 0.01 * 6 / 9, log_difference(environment, truth)
    assert found[0, 1, 2].tolist() == pytest.approx(
        [math.log((2 + floor) / (t + floor)) for t in (4, 1, 1)], rel=1e-4
    )
    assert found[1, 0, 3].tolist() == pytest.approx(
        [math.log(floor / (t + floor)) for t in (4, 1, 1)], rel=1e-4
    )
    assert found[2].abs().max() == 0  # negative light counts as none
    assert found[3, 0, 0].tolist() == pytest.approx([math.log((0.5 + floor) / floor)] * 3, rel=1e-4)


def test_a_log_difference_is_aligned_by_its_mean_over_solid_angle() -> None:
    """A texel in the middle of a face is larger than one in its corner."""
    solid, difference = cubemap.solid_angles(4), torch.zeros(6, 4, 4, 3)
    difference[3, 1, 1], difference[5, 0, 0] = torch.tensor([3.0, 0.0, 6.0]), torch.tensor([0.0, 9.0, 0.0])
    inner, outer = float(solid[3, 1, 1]) / (4 * math.pi), float(solid[5, 0, 0]) / (4 * math.pi)
    assert inner > 1.5 * outer
    means = [3 * inner, 9 * outer, 6 * inner]
    assert aligned(difference, per_channel=True)[0, 0, 0].tolist() == pytest.approx(
        [-mean for mean in means], rel=1e-4
    )
    assert aligned(difference)[3, 1, 1].tolist() == pytest.approx(
        [value - sum(means) / 3 for value in (3, 0, 6)], rel=1e-4
    )

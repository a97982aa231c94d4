import numpy as np
import pytest

from lightprobe.insertion.grain import Grain

SHAPE = (160, 160)


def picture(deviation: float) -> np.ndarray:
    ramp = np.linspace(0.2, 0.8, SHAPE[1])
    noise = np.random.default_rng(0).normal(0, deviation, (*SHAPE, 3))
    return np.repeat(ramp[None, :, None], SHAPE[0], 0) + noise


@pytest.mark.parametrize("deviation", [0.005, 0.02, 0.05])
def test_the_deviation_of_noise_is_found(deviation):
    found = Grain.of(picture(deviation), np.ones(SHAPE, bool)).deviation
    assert found == pytest.approx(np.full_like(found, deviation), rel=0.12)


def test_texture_on_half_of_the_picture_is_no_grain():
    shown = picture(0.0)
    shown[:80] += np.random.default_rng(1).choice([-0.1, 0.1], (80, SHAPE[1], 1))
    assert Grain.of(shown, np.ones(SHAPE, bool)).deviation.max() < 0.002


def test_grain_is_added_only_where_asked_and_repeats():
    grain = Grain.of(picture(0.02), np.ones(SHAPE, bool))
    weight = np.zeros(SHAPE)
    weight[40:120, 40:120] = 1
    flat = np.full((*SHAPE, 3), 0.5)
    grained = grain.add(flat, weight, 3)
    assert np.array_equal(grained, grain.add(flat, weight, 3))
    assert np.array_equal(grained[:40], flat[:40])
    assert (grained - flat)[50:110, 50:110].std() == pytest.approx(0.02, rel=0.1)

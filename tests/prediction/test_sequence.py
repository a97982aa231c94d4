"""Maps of a video's frames: flicker goes, a moving light and a switch stay."""

import pytest
import torch

from lightprobe.evaluation.metrics import environment_log_rmse, log_difference
from lightprobe.prediction.sequence import flicker, steadied
from tests.lit_sphere import patch_light


def noisy(lights, spread=0.3, seed=0):
    random = torch.Generator().manual_seed(seed)
    return lights * torch.exp(spread * torch.randn(lights.shape, generator=random))


def error(lights, truth):
    return sum(environment_log_rmse(log_difference(a, b)) for a, b in zip(lights, truth, strict=True)) / len(
        truth
    )


def test_a_still_light_stops_flickering():
    truth = patch_light((0.2, 1.0, 0.5)).expand(12, 6, 16, 16, 3)
    seen = noisy(truth)
    steady = steadied(seen, torch.full(seen.shape[:-1], 0.5))
    assert flicker(steady) < 0.3 * flicker(seen)
    assert error(steady, truth) < 0.6 * error(seen, truth)


def test_a_switch_stays_sharp():
    dark, bright = 0.2 * patch_light((0.2, 1.0, 0.5)), patch_light((-1.0, 0.3, 0.2))
    truth = torch.stack([dark] * 6 + [bright] * 6)
    steady = steadied(noisy(truth), torch.full(truth.shape[:-1], 0.5))
    assert error(steady, truth) < 0.6 * error(noisy(truth), truth)
    for place in (5, 6):  # the frames beside the switch
        assert environment_log_rmse(log_difference(steady[place], truth[place])) < 0.25


def test_what_is_trusted_counts_more():
    truth = patch_light((0.2, 1.0, 0.5)).expand(9, 6, 16, 16, 3)
    seen, trust = noisy(truth, 0.1), torch.full(truth.shape[:-1], 0.8)
    wrong = seen.clone()
    wrong[4, 2] *= 1.5
    doubted = trust.clone()
    doubted[4, 2] = 0.01
    errors = [error(steadied(wrong, part)[4:5], truth[4:5]) for part in (trust, doubted)]
    assert errors[1] < 0.8 * errors[0]


@pytest.mark.parametrize("count", [1, 2])
def test_few_frames_are_no_trouble(count):
    lights = noisy(patch_light((0.2, 1.0, 0.5)).expand(count, 6, 16, 16, 3))
    steady = steadied(lights, torch.ones(lights.shape[:-1]))
    assert steady.shape == lights.shape
    assert steady.isfinite().all()
    if count == 1:
        torch.testing.assert_close(steady, lights, rtol=1e-4, atol=1e-5)
        assert flicker(lights) == 0

import pytest
import torch
from scipy.stats import chi2

from lightprobe.models.probe_pixels import sample_pixels


@pytest.mark.slow
def test_the_first_draw_follows_one_minus_roughness():
    roughness = torch.tensor([0.05, 0.3, 0.5, 0.7, 0.9])
    draws = 4000
    counts = torch.zeros(5, dtype=torch.float64)
    for step in range(draws):
        counts[sample_pixels(roughness, 1, seed=3, stream="test", step=step)] += 1
    expected = draws * ((1 - roughness) / (1 - roughness).sum()).double()
    statistic = float(((counts - expected) ** 2 / expected).sum())
    assert statistic < chi2.ppf(0.999, df=4)


@pytest.mark.slow
def test_pairs_are_drawn_without_replacement():
    """With two of three drawn, the one left out is k with the probability of successive sampling."""
    roughness = torch.tensor([0.2, 0.5, 0.8])
    p = (1 - roughness).double() / (1 - roughness).double().sum()
    left_out = torch.zeros(3, dtype=torch.float64)
    draws = 4000
    for step in range(draws):
        chosen = sample_pixels(roughness, 2, seed=5, stream="test", step=step)
        assert len(chosen.unique()) == 2
        left_out[[k for k in range(3) if k not in chosen.tolist()]] += 1
    expected = torch.stack(
        [
            draws * sum(p[i] * p[j] / (1 - p[i]) for i, j in ((a, b), (b, a)))
            for a, b in ((1, 2), (0, 2), (0, 1))
        ]
    )
    assert float(((left_out - expected) ** 2 / expected).sum()) < chi2.ppf(0.999, df=2)


def test_draws_depend_on_step_and_seed_only():
    roughness = torch.rand(500, generator=torch.Generator().manual_seed(0))
    first = sample_pixels(roughness, 50, seed=1, stream="s", step=7)
    assert torch.equal(first, sample_pixels(roughness, 50, seed=1, stream="s", step=7))
    assert not torch.equal(first, sample_pixels(roughness, 50, seed=1, stream="s", step=8))
    assert not torch.equal(first, sample_pixels(roughness, 50, seed=2, stream="s", step=7))


def test_a_matte_object_and_a_small_one_still_have_probes():
    assert len(sample_pixels(torch.ones(100), 10, seed=0, stream="s").unique()) == 10
    assert torch.equal(sample_pixels(torch.rand(5), 10, seed=0, stream="s"), torch.arange(5))

"""A change is kept where its own part is surely better explained and the object's halves disagree no more."""

from types import SimpleNamespace

import pytest
import torch

from lightprobe.reconstruction.trials.evidence import Bar, Evidence, standard_error


def evidence(whole: float, own: float, noise: float = 0.01, photos: int = 12):
    """Return evidence before and after a change with these gains in the mean, and the noise of a photo's."""
    wave = noise * torch.tensor([(-1.0) ** k for k in range(photos)], dtype=torch.float64)
    one = torch.ones(photos, dtype=torch.float64)
    trials = [SimpleNamespace(disagreement=found) for found in (one, (wave - whole).exp())]
    return Evidence(trials[0], one), Evidence(trials[1], (wave - own).exp())


@pytest.mark.parametrize(
    ("whole", "own", "noise", "photos", "accepted"),
    [
        (0.02, 0.05, 0.01, 12, True),
        (-0.002, 0.05, 0.01, 12, True),
        (-0.02, 0.05, 0.01, 12, False),  # halves explain each other worse
        (0.02, -0.05, 0.01, 12, False),  # the part itself is explained worse
        (0.02, 0.05, 0.1, 12, False),  # not surely better
        (0.02, 0.05, 0.01, 7, False),  # too few photos
    ],
)
def test_a_change_needs_both_to_speak_for_it(whole, own, noise, photos, accepted):
    before, after = evidence(whole, own, noise, photos)
    assert after.speaks_for_change(before) is accepted


def test_photos_that_hardly_show_the_part_have_no_say():
    before, after = evidence(0.02, 0.05)
    after.own[:5] = float("nan")
    assert not after.speaks_for_change(before)  # seven are left
    assert len(after.own_gain(before)) == 7


def test_a_higher_bar_is_not_cleared_by_as_little():
    before, after = evidence(0.02, 0.05, noise=0.02)
    assert after.speaks_for_change(before)
    assert not after.speaks_for_change(before, Bar(least=0.06))
    assert not after.speaks_for_change(before, Bar(sure=9.0))


def test_halves_are_not_asked_where_the_part_is_explained_worse():
    before, after = evidence(0.02, -0.05)
    assert not Evidence(SimpleNamespace(), after.own).speaks_for_change(before)


@pytest.mark.parametrize(
    ("gain", "spread", "cleared"), [(0.02, 0, False), (0.05, 0, True), (0.05, 0.2, False)]
)
def test_a_mean_gain_clears_its_bound_and_its_own_uncertainty(gain, spread, cleared):
    gains = gain + spread * torch.linspace(-1, 1, 8, dtype=torch.float64)
    assert Bar(sure=2.0, least=0.03).cleared_by(gains) is cleared
    assert not Bar().cleared_by(gains[:0])
    assert standard_error(gains[:1]) == 0

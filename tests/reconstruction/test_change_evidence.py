"""A change of the object is kept where its own part is surely better explained and the object's halves no
worse.
"""

import pytest
import torch
from lightprobe.reconstruction.change_evidence import Bar, Evidence


def evidence(whole: float, own: float, noise: float = 0.01, photos: int = 12):
    """Return evidence before and after a change with these gains in the mean, and the noise of a photo's."""
    wave = noise * torch.tensor([(-1.0) ** k for k in range(photos)], dtype=torch.float64)
    one = torch.ones(photos, dtype=torch.float64)
    return Evidence(one, lambda: one), Evidence((wave - own).exp(), lambda: (wave - whole).exp())


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
    def asked():
        raise AssertionError("halves were asked")

    before, after = evidence(0.02, -0.05)
    assert not Evidence(after.own, asked).speaks_for_change(before)

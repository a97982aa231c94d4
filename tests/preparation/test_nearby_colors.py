"""A colour that both sides have is told by where it is."""

import numpy as np
import pytest
import torch

from lightprobe.core.threads import in_threads
from lightprobe.preparation.nearby_colors import likelier_inside

pytest.importorskip("cv2")

GOLD, GREY = (190, 150, 60), (120, 122, 125)
ROWS, COLUMNS = np.mgrid[:120, :200]
RADIUS = np.hypot(ROWS - 60, COLUMNS - 60)


def picture():
    """A gold disc before grey, and gold things elsewhere in the surroundings: four fifths of these are gold."""
    gold = (RADIUS < 30) | (COLUMNS > 120)
    color = np.where(gold[..., None], GOLD, GREY) + np.random.default_rng(0).normal(0, 6, (120, 200, 3))
    return np.clip(color, 0, 255).astype(np.uint8)


def test_a_rim_is_the_object_s_where_nothing_like_it_is_near():
    found = likelier_inside(picture(), RADIUS < 22, RADIUS > 36, 8.0)
    assert found.shape == (120, 200)
    assert (found[(RADIUS > 24) & (RADIUS < 29)] > 1).mean() > 0.97
    assert (found[(RADIUS > 31) & (RADIUS < 35)] < -1).mean() > 0.97


def test_far_from_either_side_nothing_is_said():
    found = likelier_inside(picture(), RADIUS < 22, RADIUS > 36, 4.0)
    assert not found[:, 150:].any()
    assert not likelier_inside(picture(), RADIUS < 22, RADIUS > 500, 8.0).any()


@pytest.mark.parametrize("rim", [(50, 70, 150), (150, 60, 160), (250, 250, 250), (200, 30, 30)])
def test_a_colour_that_neither_side_has_is_left_undecided(rim):
    color = picture()
    ring = (RADIUS > 24) & (RADIUS < 28)
    color[ring] = rim
    found = likelier_inside(color, RADIUS < 22, RADIUS > 36, 8.0)
    assert (np.abs(found[(RADIUS > 25) & (RADIUS < 27)]) < 1).mean() > 0.95


def test_several_threads_find_the_same(monkeypatch):
    monkeypatch.setattr(torch, "get_num_threads", lambda: 4)
    alone = likelier_inside(picture(), RADIUS < 22, RADIUS > 36, 8.0)
    together = in_threads(lambda _: likelier_inside(picture(), RADIUS < 22, RADIUS > 36, 8.0), range(8))
    assert all(np.array_equal(alone, found) for found in together)

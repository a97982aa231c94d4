"""A colour that both sides have is told by where it is."""

import numpy as np
import pytest

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


def test_equal_pictures_have_equal_answers():
    first, again = (likelier_inside(picture(), RADIUS < 22, RADIUS > 36, 8.0) for _ in range(2))
    assert np.array_equal(first, again)

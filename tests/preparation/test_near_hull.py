"""Around a hull that lost a rim, what is near and what was seen there bring it back."""

import numpy as np
import pytest
import torch

from lightprobe.core.threads import in_threads
from lightprobe.preparation import near_hull
from lightprobe.preparation.cutting import BACKGROUND, OBJECT
from lightprobe.preparation.masks import View
from lightprobe.preparation.near_hull import cut_near_hull, likelier_inside, point_marks, rim
from tests.preparation.ring import SIZE, ball_points, photographed, ring_cameras

pytest.importorskip("cv2")
GOLD, GREY, BLUE = (190, 150, 60), (120, 122, 125), (50, 70, 150)
CAMERA = ring_cameras(12)[0]
RADIUS = np.hypot(*(np.mgrid[:SIZE, :SIZE] + 0.5 - SIZE / 2))
# Radii: of the disc, of a dark ridge on it, of what masks kept.
TRUE, RIDGE, KEPT = 0.3 * SIZE, 0.26 * SIZE, 0.25 * SIZE
MARGIN = 0.16
ROWS, COLUMNS = np.mgrid[:120, :200]
DISTANCE = np.hypot(ROWS - 60, COLUMNS - 60)


def view(rim_color=None):
    """A disc, left gold and right blue, with a ridge near its rim, before grey on the left and gold on the
    right.
    """
    left = (np.indices(RADIUS.shape)[1] < SIZE / 2)[..., None]
    color = np.where((RADIUS < TRUE)[..., None], np.where(left, GOLD, BLUE), np.where(left, GREY, GOLD))
    color = np.where((np.abs(RADIUS - RIDGE) < 0.6)[..., None], 0.6 * color, color)
    if rim_color is not None:
        color = np.where(((RADIUS > RIDGE + 1) & (RADIUS < TRUE))[..., None], rim_color, color)
    color = color + np.random.default_rng(0).normal(0, 6, color.shape)
    return View(CAMERA, np.clip(color, 0, 255).astype(np.uint8), None, False)


@pytest.fixture
def trimap(monkeypatch):
    """Return what `cut` would be given: the labels of a view's pixels around a hull that ends at the ridge."""
    monkeypatch.setattr(near_hull, "cut", lambda color, labels: labels)
    shape = RADIUS < RIDGE
    assert rim(shape, MARGIN) > TRUE - RIDGE
    return lambda view, marks=None: cut_near_hull(view, shape, RADIUS < KEPT, MARGIN, None, marks)


def test_a_rim_behind_a_ridge_is_the_object_s(trimap):
    labels = trimap(view())
    assert (labels[(RADIUS > RIDGE + 2) & (RADIUS < TRUE - 1)] == OBJECT).mean() > 0.9
    assert (labels[RADIUS > TRUE + 1] == BACKGROUND).mean() > 0.9


def test_what_has_the_surroundings_colour_is_the_object_s_where_the_photo_saw_points_of_it(trimap):
    ring = (RADIUS > RIDGE + 2) & (RADIUS < TRUE - 1) & (np.indices(RADIUS.shape)[1] < SIZE / 2)
    on = ring & (np.indices(RADIUS.shape).sum(0) % 3 == 0)
    off = (RADIUS > KEPT - 4) & (RADIUS < KEPT - 2)
    assert not (trimap(view(GREY))[ring] == OBJECT).any()
    labels = trimap(view(GREY), (on, off))
    assert (labels[on] == OBJECT).all()
    assert (labels[off] == BACKGROUND).all()


def test_points_mark_the_photos_that_saw_them():
    _, _, solution = photographed([CAMERA, *ring_cameras(12)[1:]], ball_points(60))
    labels = np.where(np.arange(60) < 40, 1, -1).astype(np.int8)
    picture = view()
    on, off = point_marks(picture, solution, labels, 0)
    assert on.any()
    assert off.any()
    assert not (on & off).any()
    assert on.sum() > off.sum()
    unseen = point_marks(picture, solution, labels, 99)
    assert not unseen[0].any()
    assert not unseen[1].any()


def picture():
    """A gold disc before grey, and gold things elsewhere in the surroundings: four fifths of these are gold."""
    gold = (DISTANCE < 30) | (COLUMNS > 120)
    color = np.where(gold[..., None], GOLD, GREY) + np.random.default_rng(0).normal(0, 6, (120, 200, 3))
    return np.clip(color, 0, 255).astype(np.uint8)


def test_a_rim_is_the_object_s_where_nothing_like_it_is_near():
    found = likelier_inside(picture(), DISTANCE < 22, DISTANCE > 36, 8.0)
    assert found.shape == (120, 200)
    assert (found[(DISTANCE > 24) & (DISTANCE < 29)] > 1).mean() > 0.97
    assert (found[(DISTANCE > 31) & (DISTANCE < 35)] < -1).mean() > 0.97


def test_far_from_either_side_nothing_is_said():
    found = likelier_inside(picture(), DISTANCE < 22, DISTANCE > 36, 4.0)
    assert not found[:, 150:].any()
    assert not likelier_inside(picture(), DISTANCE < 22, DISTANCE > 500, 8.0).any()


@pytest.mark.parametrize("rim", [(50, 70, 150), (150, 60, 160), (250, 250, 250), (200, 30, 30)])
def test_a_colour_that_neither_side_has_is_left_undecided(rim):
    color = picture()
    ring = (DISTANCE > 24) & (DISTANCE < 28)
    color[ring] = rim
    found = likelier_inside(color, DISTANCE < 22, DISTANCE > 36, 8.0)
    assert (np.abs(found[(DISTANCE > 25) & (DISTANCE < 27)]) < 1).mean() > 0.95


def test_several_threads_find_the_same(monkeypatch):
    monkeypatch.setattr(torch, "get_num_threads", lambda: 4)
    alone = likelier_inside(picture(), DISTANCE < 22, DISTANCE > 36, 8.0)
    together = in_threads(lambda _: likelier_inside(picture(), DISTANCE < 22, DISTANCE > 36, 8.0), range(8))
    assert all(np.array_equal(alone, found) for found in together)

"""A ball with a hole in one photo: told by points behind it that this photo saw, and by the colours around
them.
"""

from dataclasses import replace

import numpy as np
import pytest

from lightprobe.preparation import openings as finding
from lightprobe.preparation.masks import View, carve, silhouette_of
from lightprobe.preparation.near_hull import cut_near_hull
from lightprobe.scene.consistency import overlap
from tests.preparation.ring import SIZE, ball_points, disc, photographed, ring_cameras

pytest.importorskip("cv2")

HOLED, MARGIN = 3, 0.05
HOLE = np.hypot(*(np.mgrid[:SIZE, :SIZE] - SIZE / 2)) < 18


def world(*, painted=True, behind=12):
    """Return what was seen of the ball, of points behind it through the hole, too; views, labels, and the
    hull.
    """
    cameras, rng = ring_cameras(12), np.random.default_rng(1)
    eye = cameras[HOLED].position
    through = -0.6 * eye + rng.normal(0, 0.05, (behind, 3))
    ball = ball_points(150)
    _, _, solution = photographed(cameras, np.concatenate([ball, through]))
    labels = np.where(np.arange(len(solution.points)) < len(ball), 1, -1).astype(np.int8)
    facing = np.stack([ball @ camera.position > 0.2 for camera in cameras])  # (photos, points)
    saw = np.concatenate([facing, np.arange(12)[:, None] == np.full(behind, HOLED)], 1)
    photo, point = np.nonzero(saw)
    solution = replace(solution, seen_by=photo, seen=point)
    views = {}
    for index, camera in enumerate(cameras):
        inside = disc(camera) & ~(HOLE if painted and index == HOLED else np.zeros_like(HOLE))
        color = np.where(inside[..., None], [170, 70, 50], [60, 110, 120]) + rng.normal(
            0, 18, (SIZE, SIZE, 3)
        )
        views[index] = View(camera, np.clip(color, 0, 255).astype(np.uint8), None, False)
    return solution, views, labels, carve(views, {index: disc(view.camera) for index, view in views.items()})


def openings(solution, views, labels, cutout, margin):
    shapes = {index: silhouette_of(cutout, view) for index, view in views.items()}
    return finding.openings(solution, views, labels, cutout, shapes, margin)


@pytest.mark.slow
def test_a_hole_is_found_where_points_behind_show_among_strange_colours():
    found = openings(*world(), MARGIN)
    assert set(found) == {HOLED}  # its neighbours look past the points, at the ball's own colours
    assert overlap(found[HOLED], HOLE) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("case", [{"painted": False}, {"behind": 2}, {"behind": 0}])
def test_neither_points_nor_colours_do_alone(case):
    assert openings(*world(**case), MARGIN) == {}


@pytest.mark.slow
def test_what_a_neighbour_saw_beside_the_object_tells_nothing():
    """Points behind the ball for this photo, which has a patch of their colours: it cannot see them, others
    can.
    """
    solution, views, labels, cutout = world()
    beside = HOLED + 1
    eye, side = views[HOLED].camera.position, views[beside].camera.position
    past = -4 * eye / np.linalg.norm(eye) + np.random.default_rng(2).normal(0, 0.05, (12, 3))
    moved = replace(
        solution,
        points=np.concatenate([solution.points[:150], past]),
        seen_by=np.where(solution.seen >= 150, beside, solution.seen_by),
    )
    off = np.linalg.norm(np.cross(past - side, side), axis=1) / np.linalg.norm(past - side, axis=1)
    assert off.min() > 0.8  # the ball's radius is .7
    assert openings(moved, views, labels, cutout, MARGIN) == {}


@pytest.mark.slow
def test_a_point_of_the_far_side_is_no_sight_through():
    solution, views, labels, cutout = world(behind=0)
    every = replace(
        solution, seen=np.arange(150), seen_by=np.full(150, HOLED)
    )  # a hull of false masks hides them
    assert openings(every, views, labels, cutout, MARGIN) == {}


@pytest.mark.slow
def test_without_a_hull_there_is_nothing_to_look_through():
    solution, views, labels, cutout = world()
    assert openings(solution, views, labels, replace(cutout, hull=None), MARGIN) == {}


@pytest.mark.slow
def test_a_cut_opens_what_the_hull_holds_closed():
    solution, views, labels, cutout = world()
    view, shape = views[HOLED], silhouette_of(cutout, views[HOLED])
    closed = cut_near_hull(view, shape, cutout.masks[HOLED], MARGIN)
    assert closed[HOLE].all()
    opened = cut_near_hull(
        view, shape, closed, MARGIN, openings(solution, views, labels, cutout, MARGIN)[HOLED]
    )
    assert not opened[HOLE].mean() > 0.05
    assert overlap(opened, disc(view.camera) & ~HOLE) > 0.95

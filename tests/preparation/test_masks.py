"""Points are told to lie on the object by what photos show there; masks that the user gives decide."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from lightprobe.core.errors import InputError
from lightprobe.preparation.masks import object_points
from lightprobe.preparation.voxel_labelling import View, photo_evidence
from tests.preparation.ring import SIZE, ball_points, disc, photographed, ring_cameras

pytest.importorskip("cv2")
BALL = slice(0, 150)


@pytest.fixture(scope="module")
def world():
    """Views of a ball, the points on it and on its table, and what each photo says of its pixels, one of them wrongly."""
    cameras = ring_cameras(12)
    rng = np.random.default_rng(3)
    angle, away = rng.uniform(0, 2 * np.pi, 150), rng.uniform(0.8, 1.3, 150)
    table = np.stack([away * np.cos(angle), away * np.sin(angle), np.full(150, -0.75)], axis=1)
    _, _, solution = photographed(cameras, np.concatenate([ball_points(150), table]))
    towards = solution.pose[solution.seen_by, :3, 3] - solution.points[solution.seen]
    across = np.linalg.norm(np.cross(solution.points[solution.seen], towards), axis=1)
    hidden = (across < 0.7 * np.linalg.norm(towards, axis=1)) & (solution.seen >= 150)  # by the ball
    hidden &= (solution.points[solution.seen] * towards).sum(1) < 0
    shown = {name: getattr(solution, name)[~hidden] for name in ("seen", "seen_by", "feature")}
    solution = replace(solution, **shown)
    black = np.zeros((SIZE, SIZE, 3), np.uint8)
    views = {index: View(camera, black, None, False) for index, camera in enumerate(cameras)}
    evidence = {index: np.where(disc(camera), 3.0, -3.0) for index, camera in enumerate(cameras)}
    evidence[7] = -evidence[7]
    return solution, views, evidence


def test_points_lie_where_most_photos_show_the_object(world):
    chosen = object_points(*world)
    assert chosen[BALL].mean() > 0.9
    assert not chosen[150:].any()


def test_blurred_points_are_not_taken(world):
    solution, views, evidence = world
    errors = np.where(np.arange(300) < 50, 9.0, 0.3)
    assert not object_points(replace(solution, errors=errors), views, evidence)[:50].any()


def test_what_shows_outside_of_a_hint_is_no_object_and_what_its_photo_does_not_show_may_be(world):
    solution, views, evidence = world
    half = disc(views[4].camera)
    half[:, SIZE // 2 :] = False
    hinted = {**views, 4: replace(views[4], given=half)}
    x = views[4].camera.project(solution.points)[:, 0]
    chosen = object_points(solution, hinted, evidence)
    assert not chosen[BALL][x[BALL] > SIZE / 2 + 3].any()
    assert chosen[BALL][x[BALL] < SIZE / 2].all()
    crop = replace(views[4].camera, cx=0.0)  # shows the right half of the ball alone, at its left border
    shown = np.roll(disc(views[4].camera), -SIZE // 2, axis=1)
    near = {**views, 4: View(crop, views[4].color, shown, False)}
    assert object_points(solution, near, evidence)[BALL].mean() > 0.8


def test_points_on_the_rim_of_a_hint_are_the_objects(world):
    """A mask of a drawing hand, or cameras, are off by a pixel."""
    solution, views, evidence = world
    tight = scipy.ndimage.binary_erosion(disc(views[4].camera))
    x, y, _ = views[4].camera.project(solution.points[BALL]).T
    assert not tight[y.astype(int), x.astype(int)].all()
    assert object_points(solution, {**views, 4: replace(views[4], given=tight)}, evidence)[BALL].all()


def test_a_hint_that_shows_no_point_asks_for_a_better_one(world):
    solution, views, evidence = world
    corner = np.zeros((SIZE, SIZE), bool)
    corner[:2, :2] = True
    with pytest.raises(InputError, match="--hint"):
        object_points(solution, {**views, 0: replace(views[0], given=corner)}, evidence)


def test_a_given_mask_is_evidence_and_needs_no_network(world):
    _, views, _ = world
    mask = disc(views[2].camera)
    found = photo_evidence({2: replace(views[2], given=mask, fixed=True)})
    assert np.array_equal(found[2] > 0, mask)

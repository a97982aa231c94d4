"""A ball before clutter is cut out of every photo, told by one photo's box or by where the cameras look."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from lightprobe.core.errors import InputError
from lightprobe.preparation.cutting import BACKGROUND, MAYBE_BACKGROUND, MAYBE_OBJECT, OBJECT, cut, tidy
from lightprobe.preparation.masks import (
    AGREEMENTS,
    MARGINS,
    View,
    carve,
    cut_all,
    first_trimap,
    object_points,
    silhouette_of,
)
from lightprobe.preparation.near_hull import cut_near_hull
from lightprobe.scene.consistency import overlap
from tests.preparation.ring import SIZE, ball_points, disc, photographed, ring_cameras
from tests.shapes import camera_at

pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def world():
    """Views of a reddish ball before blue-green clutter, the points on it and around it, and true masks."""
    cameras = ring_cameras(12)
    rng = np.random.default_rng(3)
    around = rng.normal(size=(150, 3))
    around *= 2.2 / np.linalg.norm(around, axis=1, keepdims=True)
    _, _, solution = photographed(cameras, np.concatenate([ball_points(150), around]))
    views, truth = {}, {}
    for index, camera in enumerate(cameras):
        inside = disc(camera)
        color = np.where(inside[..., None], [170, 70, 50], [60, 110, 120]) + rng.normal(
            0, 18, (SIZE, SIZE, 3)
        )
        views[index] = View(camera, np.clip(color, 0, 255).astype(np.uint8), None, False)
        truth[index] = inside
    return solution, views, truth


def rounds(solution, views, labels):
    masks = cut_all(views, solution, labels)
    found = carve(views, masks, AGREEMENTS[0])
    for margin, agreement in zip(MARGINS, AGREEMENTS[1:], strict=True):
        near = {
            i: cut_near_hull(v, silhouette_of(found, v), found.masks[i], margin) for i, v in views.items()
        }
        found = carve(views, near, agreement)
    return found


@pytest.mark.long
def test_without_a_hint_it_is_what_the_cameras_look_at(world):
    solution, views, truth = world
    labels = object_points(solution, views, False)
    assert (labels[:150] == 1).mean() > 0.9
    assert (labels[150:] == -1).mean() > 0.9
    found = rounds(solution, views, labels)
    assert min(overlap(found.masks[i], truth[i]) for i in truth) > 0.93
    assert np.mean(list(found.agreement.values())) > 0.93


def test_a_box_in_one_photo_tells_points_apart(world):
    solution, views, _ = world
    box = np.zeros((SIZE, SIZE), bool)
    rows, columns = np.nonzero(disc(views[4].camera))
    box[rows.min() - 3 : rows.max() + 4, columns.min() - 3 : columns.max() + 4] = True
    hinted = {**views, 4: View(views[4].camera, views[4].color, box, False)}
    labels = object_points(solution, hinted, False)
    assert (labels[:150] == 1).mean() > 0.9
    assert not (labels[150:] == 1).any()


def test_what_shows_outside_of_a_hint_is_no_object_and_what_its_photo_does_not_show_may_be(world):
    solution, views, _ = world
    half = disc(views[4].camera)
    half[:, SIZE // 2 :] = False
    hinted = {**views, 4: View(views[4].camera, views[4].color, half, False)}
    x = views[4].camera.project(solution.points)[:, 0]
    assert not (object_points(solution, hinted, False)[:150][x[:150] > SIZE / 2 + 1] == 1).any()
    crop = replace(views[4].camera, cx=0.0)  # shows the right half of the ball alone, at its left border
    near = {**views, 4: View(crop, views[4].color, np.roll(disc(views[4].camera), -SIZE // 2, axis=1), False)}
    assert (object_points(solution, near, False)[:150] == 1).mean() > 0.8


def test_points_on_the_rim_of_a_hint_are_not_called_background(world):
    """A mask of a drawing hand, or cameras, are off by a pixel: marks there would cut into the object."""
    solution, views, truth = world
    tight = scipy.ndimage.binary_erosion(truth[4])
    hinted = {**views, 4: View(views[4].camera, views[4].color, tight, False)}
    x, y, _ = views[4].camera.project(solution.points[:150]).T
    assert not tight[y.astype(int), x.astype(int)].all()
    assert not (object_points(solution, hinted, False)[:150] == -1).any()


def test_a_hint_that_shows_no_point_asks_for_a_better_one(world):
    solution, views, _ = world
    corner = np.zeros((SIZE, SIZE), bool)
    corner[:2, :2] = True
    with pytest.raises(InputError, match="--hint"):
        object_points(solution, {**views, 0: View(views[0].camera, views[0].color, corner, False)}, False)


@pytest.mark.long
def test_a_given_mask_stays_as_it_is(world):
    solution, views, truth = world
    mine = np.zeros((SIZE, SIZE), bool)
    mine[50:90, 60:110] = True
    fixed = {**views, 2: View(views[2].camera, views[2].color, mine, True)}
    labels = object_points(solution, views, False)
    found = rounds(solution, fixed, labels)
    assert np.array_equal(found.masks[2], mine)
    assert overlap(found.masks[5], truth[5]) > 0.9


def test_a_cut_runs_between_what_is_sure():
    color = np.full((60, 80, 3), 90, np.uint8)
    color[20:40, 30:50] = 200
    trimap = np.full((60, 80), BACKGROUND, np.uint8)
    trimap[10:50, 20:60] = MAYBE_BACKGROUND
    trimap[18:42, 28:52] = MAYBE_OBJECT
    trimap[28:32, 38:42] = OBJECT
    assert np.array_equal(cut(color, trimap), (color == 200).all(-1))
    assert not cut(color, np.full((60, 80), BACKGROUND, np.uint8)).any()


def test_only_what_a_photo_saw_itself_marks_the_object_in_it(world):
    solution, views, _ = world
    labels = np.where(np.arange(len(solution.points)) < 150, 1, -1).astype(np.int8)
    low = solution.points[solution.seen][:, 2] < 0  # of the ball's points photo 0 saw the lower ones only
    own = replace(solution, seen=solution.seen[low], seen_by=solution.seen_by[low])
    marked = np.nonzero(first_trimap(views[0], own, labels, 0) == OBJECT)[0]
    top = views[0].camera.project(np.array([[0.0, 0.0, 0.05]]))[0, 1]
    assert marked.min() > top - 0.25 * SIZE / 3
    assert marked.max() > top
    everybody = np.nonzero(first_trimap(views[0], solution, labels, 0) == OBJECT)[0]
    assert everybody.min() < marked.min() - 20


@pytest.mark.slow
def test_a_part_that_some_first_cuts_lose_is_not_lost_in_all():
    cameras = ring_cameras(40)
    black = np.zeros((SIZE, SIZE, 3), np.uint8)
    views = {i: View(camera, black, None, False) for i, camera in enumerate(cameras)}
    truth = {i: disc(camera) for i, camera in enumerate(cameras)}
    upper = np.arange(SIZE)[:, None] < cameras[0].project(np.zeros((1, 3)))[0, 1] - 15
    masks = {i: mask & ~upper if i % 10 == 0 else mask for i, mask in truth.items()}
    first, last = (
        np.mean([silhouette_of(found, view)[truth[i]].mean() for i, view in views.items()])
        for found in (carve(views, masks, share) for share in (AGREEMENTS[0], AGREEMENTS[-1]))
    )
    assert first > 0.95
    assert last < first - 0.1


def test_specks_and_pinholes_go():
    mask = np.zeros((60, 60), bool)
    mask[10:50, 10:50] = True
    clean = mask.copy()
    mask[30, 30], mask[2, 2] = False, True
    assert np.array_equal(tidy(mask), clean)


def test_a_cropped_hint_shows_how_far_a_long_object_reaches():
    """Few points lie on the long part, outside of the ball that most photos show; one photo shows all but its
    foot.
    """
    cameras = ring_cameras(12)
    rng = np.random.default_rng(5)
    mast = np.stack([rng.normal(0, 0.05, 12), rng.normal(0, 0.05, 12), np.linspace(0.9, 1.5, 12)], 1)
    _, _, solution = photographed(cameras, np.concatenate([ball_points(150), mast]))
    black = np.zeros((SIZE, SIZE, 3), np.uint8)
    views = {i: View(camera, black, None, False) for i, camera in enumerate(cameras)}
    wide = camera_at(tuple(cameras[4].position), size=SIZE, focal=160)
    column, top, _ = wide.project(np.array([[0.0, 0.0, 1.6]]))[0]
    assert 0 < top < SIZE / 3
    hint = np.zeros((SIZE, SIZE), bool)
    hint[int(top) :, int(column) - 60 : int(column) + 60] = True  # down to the border of the photo
    long = object_points(solution, {**views, 4: View(wide, views[4].color, hint, False)}, False)
    assert (long[150:] == 1).mean() > 0.9
    assert (object_points(solution, views, False)[150:] == 1).mean() < 0.5  # the cameras alone do not tell

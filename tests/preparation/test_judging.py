"""A reconstruction is judged by what it explains of the object."""

from dataclasses import replace

import numpy as np
import pytest

from lightprobe.preparation.judging import (
    ObjectMatches,
    from_one_tripod,
    moving_features,
    spread,
    unexplained,
)
from tests.preparation.ring import ball_points, photographed, ring_cameras

pytest.importorskip("pycolmap")


@pytest.fixture(scope="module")
def ring():
    return photographed(ring_cameras(8), ball_points(80))


def everywhere(photos):
    return [np.ones(len(features.points), bool) for features in photos]


def frozen(solution):
    """The same cameras, gathered around the first: what a still background says of them."""
    return replace(
        solution, pose=solution.pose[:1] + 0.002 * (solution.pose - solution.pose[:1]) * [[0], [0], [0], [1]]
    )


def test_true_cameras_explain_the_object_and_those_of_a_still_background_do_not(ring):
    photos, matches, solution = ring
    asked = ObjectMatches(photos, matches, everywhere(photos))
    right = asked.judge(solution)
    assert right.explained > 0.99
    assert right.points == 80
    pose = solution.pose.copy()
    pose[:, :3, :3] = pose[0, :3, :3]
    assert asked.judge(replace(solution, pose=pose)).explained < 0.3


def test_only_what_lies_on_the_object_is_asked(ring):
    photos, matches, solution = ring
    inside = everywhere(photos)
    for flags in inside:
        flags[40:] = False
    moved = dict(matches)
    for pair in moved:
        rows = moved[pair].copy()
        rows[40:, 1] = np.roll(rows[40:, 1], 7)
        moved[pair] = rows
    assert ObjectMatches(photos, moved, inside).judge(solution).explained > 0.99


def test_what_does_not_fit_the_cameras_is_left_over(ring):
    photos, matches, solution = ring
    rows = matches[0, 1].copy()
    rows[:20, 1] = np.roll(rows[:20, 1], 5)
    left = unexplained(photos, {(0, 1): rows}, solution)[0, 1]
    assert 10 <= len(left) <= 20
    assert (left[:, 0] < 20).all()


def test_a_background_that_stands_still_is_noticed_and_its_features_are_named(ring):
    photos, matches, _ = ring
    assert not from_one_tripod(photos, matches)
    still = [replace(f, points=np.concatenate([f.points[:20], photos[0].points[20:]])) for f in photos]
    assert from_one_tripod(still, matches)
    moving = moving_features(still, matches)
    assert moving[3][:20].mean() > 0.9
    assert not moving[3][20:].any()


def test_the_widest_angle_between_rays_is_that_of_the_cameras(ring):
    photos, matches, solution = ring
    verdict = ObjectMatches(photos, matches, everywhere(photos)).judge(solution)
    assert 100 < verdict.angle <= 180


def test_a_hint_spreads_along_matches(ring):
    photos, matches, _ = ring
    inside = [np.zeros(80, bool) for _ in photos]
    inside[0][:10] = True
    known = spread(inside, matches)
    assert known[2][:10].all()
    assert not known[2][10:].any()
    assert not known[5].any()

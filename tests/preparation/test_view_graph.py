"""An object that looks alike from two sides: pairs that fit together at a wrong angle have no vote."""

import numpy as np
import pytest

from lightprobe.preparation import view_graph
from lightprobe.preparation.features import Features
from tests.preparation.ring import SIZE, ball_points, ring_cameras

pytest.importorskip("pycolmap")
PHOTOS, POINTS = 16, 600


@pytest.fixture(scope="module")
def alike():
    """Features and matches of a ball whose back has the same pattern as its front, and the true cameras."""
    half = ball_points(POINTS // 2)
    turned = half * [-1, -1, 1]  # by half a turn
    points = np.concatenate([half, turned])
    cameras = ring_cameras(PHOTOS)
    rng = np.random.default_rng(0)
    seen = [(points @ each.position) / np.linalg.norm(each.position) > 0.25 for each in cameras]
    places = [each.project(points)[:, :2] + rng.normal(0, 0.3, (POINTS, 2)) for each in cameras]
    photos = [Features(at.astype(np.float32), np.zeros((POINTS, 0), np.uint8), SIZE, SIZE) for at in places]
    matches, twin = {}, np.roll(np.arange(POINTS), POINTS // 2)
    for i in range(PHOTOS):
        for j in range(i + 1, PHOTOS):
            right = np.flatnonzero(seen[i] & seen[j])
            wrong = np.flatnonzero(seen[i] & seen[j][twin])
            near = min(j - i, PHOTOS - j + i) <= 2
            if near:
                matches[i, j] = np.stack([right, right], 1).astype(np.uint32)
            elif (i + j) % 3 == 0:  # not every pair is taken in
                matches[i, j] = np.stack([wrong, twin[wrong]], 1)[::2].astype(np.uint32)
    return photos, matches, cameras


def test_pairs_of_two_sides_that_look_alike_are_left_out(alike):
    photos, matches, cameras = alike
    graph = view_graph.consistent(photos, matches, [300 / SIZE] * PHOTOS)
    assert len(np.unique(graph.group)) == 1
    apart = [min(j - i, PHOTOS - j + i) for i, j in graph.matches]
    assert max(apart) <= 2
    assert len(apart) == 2 * PHOTOS
    true = [np.diag([1, -1, -1]) @ each.camera_to_world[:3, :3].T for each in cameras]
    turns = [graph.rotation[k] @ graph.rotation[0].T @ true[0] @ true[k].T for k in range(PHOTOS)]
    assert min(np.trace(turn) for turn in turns) > 1 + 2 * np.cos(np.radians(5))


def test_photos_that_nothing_joins_stay_apart(alike):
    photos, matches, _ = alike
    halves = {
        pair: rows
        for pair, rows in matches.items()
        if (pair[0] < 5) == (pair[1] < 5) and pair[1] - pair[0] < 3
    }
    graph = view_graph.consistent(photos, halves, [300 / SIZE] * PHOTOS)
    assert len({int(group) for group in graph.group[:5]} & {int(group) for group in graph.group[5:]}) == 0
    assert view_graph.consistent(photos, {}, [None] * PHOTOS).matches == {}


def test_a_pair_that_was_not_asked_speaks_neither_for_nor_against():
    count, every = 40, 60  # each photo is matched with its 16 best partners, of which the last has 60 matches
    asked = [(i, j) for i in range(count) for j in range(i + 1, count) if (j - i) % count <= 8 or j - i >= 32]
    rows = np.zeros((every, 2), np.uint32)
    edges = [view_graph.Edge(pair, np.eye(3), rows) for pair in asked[1:]]
    strength = view_graph.matches_of_pairs(count, edges, asked)
    assert strength[asked[0]] == 0  # asked, and nothing fits
    assert strength[0, 20] == 0  # photo 0 has one partner less
    assert strength[5, 25] == every
    assert (
        view_graph.matches_of_pairs(count, edges, [(i, j) for i in range(count) for j in range(i)])[5, 25]
        == 0
    )


def test_few_matches_that_lack_none_are_surer_than_many_that_lack_half_as_many():
    alike = [  # of a toy engine's two sides, in six places: all are wrong
        view_graph._Hypothesis(support, balance, np.eye(3)) for support, balance in ((1392, 655), (1110, 106))
    ]
    beside = [view_graph._Hypothesis(400, 390, np.eye(3))]
    assert view_graph._margin(alike) > view_graph._margin(beside)
    assert view_graph._sureness(alike) < view_graph._sureness(beside)

"""A box that is carried from table to table is cut out as what all places share, down to where it stands."""

import numpy as np
import pytest

from lightprobe.preparation.minimum_cut import minimum_cut
from lightprobe.preparation.support_plane import above_planes, find_planes, shared_points
from lightprobe.preparation.voxel_labelling import edge_cut, label_voxels
from lightprobe.scene.consistency import overlap
from tests.preparation.tables import HALF, SIZE, world

pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def shoot():
    return world()


def test_only_what_several_places_show_is_shared(shoot):
    _, _, places, solution = shoot
    shared = shared_points(solution, places)
    assert shared[:60].all()
    assert not shared[60:].any()


def test_the_plane_is_the_table_in_every_place(shoot):
    _, _, places, solution = shoot
    planes = find_planes(solution, places, shared_points(solution, places))
    assert sorted(planes) == [0, 1, 2]
    for plane in planes.values():
        assert plane.normal @ [0, 0, 1] > 0.9999
        assert plane.offset == pytest.approx(-HALF[2], abs=1e-3)


def test_a_place_where_the_object_lies_on_its_side_has_a_plane_of_its_own(shoot):
    _, _, places, solution = shoot
    points = solution.points.copy()
    own = np.unique(solution.seen[np.array([places[int(i)] for i in solution.seen_by]) == 2])
    own = own[own >= 60]
    points[own] = points[own][:, [2, 1, 0]] * [-1, 1, 1] - [HALF[2] + HALF[0], 0, 0]  # x = -HALF[0]
    poses = solution.pose.copy()
    for photo, place in places.items():
        if place == 2:
            poses[photo, 0, 3] = abs(poses[photo, 0, 3]) + 1  # cameras stay above their table
    moved = type(solution)(**{**vars(solution), "points": points, "pose": poses})
    planes = find_planes(moved, places, shared_points(solution, places))
    assert planes[0].normal @ [0, 0, 1] > 0.999
    assert abs(planes[2].normal @ [1, 0, 0]) > 0.99


def test_no_plane_is_found_where_points_lie_anywhere():
    _, _, places, solution = world(places=2, photos=3)
    points = np.random.default_rng(1).normal(0, 1, solution.points.shape)
    scattered = type(solution)(**{**vars(solution), "points": points})
    assert find_planes(scattered, places, np.arange(len(points)) < 60) == {}


def test_points_on_the_plane_are_not_the_objects(shoot):
    _, _, places, solution = shoot
    planes = find_planes(solution, places, shared_points(solution, places))
    labels = above_planes(solution, np.ones(len(solution.points), np.int8), planes)
    assert (labels[60:] == -1).all()
    assert (labels[:60] == 1).mean() > 0.8  # but for points at its foot


@pytest.mark.slow
def test_the_box_is_cut_out_and_no_table_with_it(shoot):
    views, truth, places, solution = shoot
    shared = shared_points(solution, places)
    planes = find_planes(solution, places, shared)
    labels = above_planes(solution, shared.astype(np.int8), planes)
    found = label_voxels(views, places, solution, labels == 1, planes)
    assert min(overlap(found.masks[i], truth[i]) for i in truth) > 0.93
    assert min(found.agreement.values()) > 0.85
    low = found.hull.centers(found.hull.occupancy).min(axis=0)
    assert low[2] == pytest.approx(-HALF[2], abs=2 * found.hull.voxel[2])


def test_a_cut_is_straight_where_little_speaks_against_it():
    evidence = np.where(np.arange(40)[None] < 20, 1.0, -1.0) * np.ones((40, 1))
    noisy = evidence.copy()
    noisy[20, 30] = 3.0
    assert np.array_equal(minimum_cut(noisy, 1.0, 300), evidence > 0)
    assert np.array_equal(minimum_cut(noisy, 0.01, 300), noisy > 0)


def test_a_mask_ends_at_the_photos_edge_near_the_silhouette():
    lab = np.zeros((SIZE, SIZE, 3), np.float32)
    lab[..., 0] = np.where(np.arange(SIZE)[None] < 80, 200, 50)
    shape = np.zeros((SIZE, SIZE), bool)
    shape[40:120, 20:82] = True
    undecided = np.zeros((SIZE, SIZE), np.float32)
    mask = edge_cut(lab, undecided, shape)
    assert np.flatnonzero(mask[80])[-1] == 79
    assert not edge_cut(lab, undecided, np.zeros_like(shape)).any()

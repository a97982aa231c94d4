"""A box that is carried from table to table is cut out, down to where it stands, though single photos err."""

from dataclasses import replace

import numpy as np
import pytest

from lightprobe.preparation.minimum_cut import minimum_cut
from lightprobe.preparation.outlines import edge_cut, outlined_mask, stability
from lightprobe.preparation.support_plane import common_plane
from lightprobe.preparation.voxel_labelling import label_voxels, photo_evidence
from lightprobe.scene.consistency import overlap
from tests.preparation.tables import HALF, SIZE, world

pytest.importorskip("cv2")
BOX = slice(0, 60)  # of the points


@pytest.fixture(scope="module")
def shoot():
    return world(places=2, photos=6)


def test_the_plane_is_the_table(shoot):
    _, _, _, solution = shoot
    plane = common_plane(solution, np.arange(len(solution.points)) < 60)
    assert plane.normal @ [0, 0, 1] > 0.9999
    assert plane.offset == pytest.approx(-HALF[2], abs=1e-3)


def test_no_plane_is_found_where_points_lie_anywhere(shoot):
    _, _, _, solution = shoot
    points = np.random.default_rng(1).normal(0, 1, solution.points.shape)
    assert common_plane(replace(solution, points=points), np.arange(len(points)) < 60) is None


@pytest.mark.slow
def test_the_box_is_cut_out_and_no_table_with_it(shoot):
    views, truth, _, solution = shoot
    evidence = photo_evidence(views)
    found = label_voxels(views, evidence, solution.points[BOX])
    alone = [overlap(evidence[photo] > 0, truth[photo]) for photo in truth]
    masks = {
        photo: outlined_mask(views[photo], found.evidence[photo], found.shapes[photo]) for photo in views
    }
    together = [overlap(masks[photo], truth[photo]) for photo in truth]
    assert min(together) > 0.9
    assert np.mean(together) > np.mean(alone)
    widest = {i: found.widest.silhouette(views[i].camera) for i in masks}
    assert np.mean([stability(masks[i], found.shapes[i], widest[i]) for i in masks]) > 0.9


@pytest.mark.slow
def test_nothing_outside_of_a_hint_is_left_and_a_fixed_mask_stays(shoot):
    views, truth, _, solution = shoot
    half = truth[3].copy()
    half[:, : SIZE // 2] = False
    hinted = {**views, 3: replace(views[3], given=half), 5: replace(views[5], given=truth[5], fixed=True)}
    found = label_voxels(hinted, photo_evidence(hinted), solution.points[BOX])
    masks = {i: outlined_mask(hinted[i], found.evidence[i], found.shapes[i]) for i in (3, 5)}
    assert np.array_equal(masks[5], truth[5])
    assert masks[3][:, : SIZE // 2 - 8].sum() == 0
    assert found.hull.silhouette(views[3].camera)[:, : SIZE // 2 - 8].sum() == 0


@pytest.mark.slow
def test_masks_are_unstable_where_photos_are_torn_about_a_part(shoot):
    views, truth, _, solution = shoot
    right, torn = photo_evidence(views), photo_evidence(views)
    for photo in list(torn)[: 2 * len(views) // 3]:  # the network takes the upper half for background
        upper = np.arange(SIZE)[:, None] < np.median(np.nonzero(truth[photo])[0])
        torn[photo] = np.where(upper & truth[photo], -np.abs(torn[photo]), torn[photo])

    def mean(evidence):
        found = label_voxels(
            views, evidence, solution.points[BOX], look=lambda photo, color, box: evidence[photo]
        )
        widest = {i: found.widest.silhouette(views[i].camera) for i in views}
        return np.mean([stability(found.shapes[i], found.shapes[i], widest[i]) for i in views])

    assert mean(torn) < 0.9 < mean(right)


def test_a_mask_without_a_voxel_is_not_sure():
    empty = np.zeros((4, 4), bool)
    assert stability(empty, empty, empty) == 0


def test_a_cut_is_straight_where_little_speaks_against_it():
    evidence = np.where(np.arange(40)[None] < 20, 1.0, -1.0) * np.ones((40, 1))
    noisy = evidence.copy()
    noisy[20, 30] = 3.0
    assert np.array_equal(minimum_cut(noisy, 1.0, 300), evidence > 0)
    assert np.array_equal(minimum_cut(noisy, 0.01, 300), noisy > 0)


def test_a_mask_ends_at_the_photos_edge_near_the_silhouette():
    color = np.where(np.arange(SIZE)[None, :, None] < 80, 200, 50) * np.ones((SIZE, 1, 3))
    shape = np.zeros((SIZE, SIZE), bool)
    shape[40:120, 20:82] = True
    undecided = np.zeros((SIZE, SIZE), np.float32)
    mask = edge_cut(color.astype(np.uint8), undecided, shape)
    assert np.flatnonzero(mask[80])[-1] == 79
    assert not edge_cut(color.astype(np.uint8), undecided, np.zeros_like(shape)).any()

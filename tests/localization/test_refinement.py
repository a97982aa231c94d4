"""A pose refined by the light, whatever the light is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.localization.appearance import PhotoPyramid, appearance
from lightprobe.localization.known_object import KnownObject
from lightprobe.localization.pose import mean_distance, moved
from lightprobe.localization.refinement import (
    edge_support,
    fitted_light,
    nearest_edges,
    outline_of,
    pose_uncertainty,
    refine,
)
from tests.painted_object import photo_of

SIDE, RADIUS = 80, 20.0
DOWN, ACROSS = np.mgrid[:SIDE, :SIDE] + 0.5
SCATTER = np.array([0.06, 0.06, 0.06, 0.02, 0.02, 0.03, 0.0])  # radians, distances: starts of a search err so


def disc(x: float, y: float) -> np.ndarray:
    return np.hypot(ACROSS - x, DOWN - y) < RADIUS


def photo_of_disc(x: float, inside=(0.6, 0.3, 0.2)) -> PhotoPyramid:
    return PhotoPyramid(np.where(disc(x, 40)[..., None], inside, (0.1, 0.2, 0.4)))


def outline():
    return outline_of(np.flatnonzero(disc(40, 40)), SIDE, SIDE, 100)


def test_the_outline_runs_around_the_object_and_looks_outwards():
    found = outline()
    away = found.place - 40
    assert len(found.row) == 100
    assert np.abs(np.linalg.norm(away, axis=1) - RADIUS).max() < 1.2
    assert ((away * found.normal).sum(1) > 0.95 * np.linalg.norm(away, axis=1)).all()


def test_edges_are_found_where_the_object_really_is():
    looks = appearance(torch.tensor([[0.6, 0.3, 0.2]])).numpy().repeat(100, 0)
    support = edge_support(photo_of_disc(43).near(1.0), outline(), looks, 6)
    distance, weight = nearest_edges(support)
    expected = 3 * outline().normal[:, 0]
    assert np.median(np.abs(distance - expected)) < 0.6
    assert weight.mean() > 0.7


def test_an_edge_of_something_else_has_no_support():
    looks = appearance(torch.tensor([[0.02, 0.3, 0.02]])).numpy().repeat(100, 0)
    assert nearest_edges(edge_support(photo_of_disc(43).near(1.0), outline(), looks, 6))[1].max() < 0.1


def test_an_object_outside_the_photo_has_no_outline():
    assert len(outline_of(np.arange(0), SIDE, SIDE, 10).row) == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [20, 21])
def test_poses_come_back_under_any_light(known, camera, seed):
    points = known.mesh.vertices[::20].double().numpy()
    pyramid = PhotoPyramid(photo_of(known.asset, camera, seed)[0])
    random, errors = np.random.default_rng(0), []
    for _ in range(4):
        start = moved(camera, random.normal(size=7) * SCATTER)
        found = start
        for diameter, steps in ((40, 3), (80, 5), (120, 6)):
            found, fit = refine(known, pyramid, found, diameter=diameter, steps=steps)
        assert fit.score > refine(known, pyramid, start, diameter=120, steps=0)[1].score + 0.3
        errors.append(mean_distance(found, camera, points))
    assert sum(error < 1.6 for error in errors) >= 3  # of 128 pixels: from there, finer steps go on


def test_a_free_focal_length_is_found_as_well(known, camera, pyramid):
    points = known.mesh.vertices[::20].double().numpy()
    start = moved(camera, np.array([0, 0, 0, 0, 0, 0, 0.3]))
    found, _ = refine(known, pyramid, start, diameter=120, steps=12, focal=True)
    assert abs(np.log(found.fx / camera.fx)) < 0.1
    assert mean_distance(found, camera, points) < 0.6
    assert refine(known, pyramid, start, diameter=120, steps=3)[0].fx == pytest.approx(start.fx)


def test_a_pose_that_stands_still_for_two_steps_is_not_refined_on(known, camera, pyramid):
    start = moved(camera, np.array([0.05, 0, 0, 0.02, 0, 0, 0]))
    short, long = (refine(known, pyramid, start, diameter=80, steps=steps) for steps in (1, 6))
    stopped = refine(known, pyramid, start, diameter=80, steps=6, still=100.0)  # no step moves it that far
    assert np.array_equal(stopped[0].camera_to_world, short[0].camera_to_world)
    never = refine(known, pyramid, start, diameter=80, steps=6, still=1e-9)
    assert np.array_equal(never[0].camera_to_world, long[0].camera_to_world)
    assert not np.array_equal(short[0].camera_to_world, long[0].camera_to_world)


def test_exposure_changes_nothing(known, camera, photo):
    fits = [refine(known, PhotoPyramid(f * photo[0]), camera, diameter=80, steps=0)[1] for f in (1.0, 0.5)]
    assert fits[0].explained == pytest.approx(fits[1].explained, abs=0.02)


def test_an_object_behind_the_camera_is_nothing(known, camera, pyramid):
    turned = moved(camera, np.array([0, 0, 0, 0, 0, 2.0, 0]))  # the object now lies behind
    assert refine(known, pyramid, turned, diameter=60, steps=2)[1].score < 0.1


def test_a_plain_smooth_object_could_lie_elsewhere_where_a_painted_one_could_not(known, camera, pyramid):
    points, textures = known.mesh.vertices[::20].double().numpy(), known.asset.textures
    painted = pose_uncertainty(known, pyramid, camera, points, diameter=120)
    grey = torch.full_like(textures.base_color, 0.5)
    plain = KnownObject(replace(known.asset, textures=replace(textures, base_color=grey)))
    photo = PhotoPyramid(photo_of(plain.asset, camera, 20)[0])
    assert pose_uncertainty(plain, photo, camera, points, diameter=120) > 2 * painted
    behind = moved(camera, np.array([0, 0, 0, 0, 0, 2.0, 0]))
    assert pose_uncertainty(known, pyramid, behind, points, diameter=120) == np.inf


def test_the_light_is_the_ridge_regression():
    random = np.random.default_rng(0)
    matrix, light = random.random((3, 200, 6)), random.random((3, 6)) + 0.5
    color = np.einsum("cnt,ct->cn", matrix, light)
    weight, ridge, found = fitted_light(matrix, color, np.zeros((3, 200), bool))
    for c in range(3):
        left = matrix[c].T @ (weight[c] * (color[c] - matrix[c] @ found[c]))
        level = ((found[c] - left / ridge[c]) if ridge[c] else found[c]).mean()
        assert np.allclose(left, ridge[c] * (found[c] - level), rtol=1e-5, atol=1e-6 * np.abs(ridge[c]))
    spoilt = color.copy()
    spoilt[:, :20] = 0
    clipped = np.zeros((3, 200), bool)
    clipped[:, :20] = True
    kept = fitted_light(matrix[:, 20:], color[:, 20:], clipped[:, 20:])[2]
    assert np.abs(fitted_light(matrix, spoilt, clipped)[2] - kept).max() < 0.1 * np.abs(kept).max()

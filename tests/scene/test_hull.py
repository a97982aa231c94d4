from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from lightprobe.core.errors import InputError
from lightprobe.scene import carved_hull, visual_hull
from lightprobe.scene.hull import Hull, projection_matrix
from lightprobe.scene.normalise import find_similarity, first_guess
from tests.scene.balls import ball_views, disc
from tests.scene.worlds import BALLS, MIDDLE, expected_camera, picture, views
from tests.shapes import camera_at

BOX = {"lo": (-1.05,) * 3, "hi": (1.05,) * 3}
COUNT = 24
CENTRAL = (COUNT // 2,) * 3


def worlds_cameras(shots):
    return [expected_camera(view) for view in shots], [picture(view)[1] / 255 for view in shots]


def test_projection_matrix_agrees_with_project():
    camera = camera_at((1, 2, 3), size=50, width=70)
    points = np.random.default_rng(0).normal(size=(20, 3))
    homogeneous = np.concatenate([points, np.ones((20, 1))], axis=1) @ projection_matrix(camera).T
    expected = camera.project(points)
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], expected[:, :2], atol=1e-9)
    np.testing.assert_allclose(homogeneous[:, 2], expected[:, 2], atol=1e-9)


def test_votes_agree_with_a_plain_count():
    cameras, alphas = ball_views(size=40, width=48)
    alphas[2] = 1 - alphas[2]  # something for the votes to disagree about
    hull = visual_hull(cameras, alphas, 9, lo=(-2.5, -1, -1), hi=(1, 1.5, 2.2), agreement=0.6)
    assert hull.voxel == pytest.approx(np.array([3.5, 2.5, 3.2]) / 9)
    points = hull.centers(np.ones((9, 9, 9), bool))
    votes, seen = np.zeros(len(points)), np.zeros(len(points))
    for camera, alpha in zip(
        cameras, alphas, strict=True
    ):  # of seven, 2.8 may disagree: up to two votes each
        far = ndimage.distance_transform_edt(alpha < 0.5) > 0.02 * 48
        u, v, depth = camera.project(points).T
        visible = (depth > 0) & (u >= 0) & (v >= 0) & (u < 48) & (v < 40)
        seen += visible
        pixel = v[visible].astype(int), u[visible].astype(int)
        votes[visible] += np.where(alpha[pixel] >= 0.5, 1, np.where(far[pixel], -1, 0))
    score = np.where(seen >= 2, votes / np.maximum(seen, 1), 0).reshape(9, 9, 9)
    np.testing.assert_allclose(hull.score, score, atol=1e-6)
    np.testing.assert_array_equal(hull.occupancy, score.astype(np.float32) >= np.float32(0.6))
    assert 0 < hull.occupancy.sum() < hull.occupancy.size


def test_hull_contains_the_ball_and_not_much_more():
    hull = visual_hull(*ball_views(size=96, focal=140), 48)
    points = hull.centers(np.ones_like(hull.occupancy))
    distance = np.linalg.norm(points, axis=1).reshape(hull.occupancy.shape)
    assert hull.occupancy[distance < 0.66].all()
    ball = 4 / 3 * np.pi * 0.7**3
    assert 1 < hull.occupancy.sum() * hull.voxel.prod() / ball < 1.35


def test_masks_may_be_smaller_than_their_cameras():
    cameras, alphas = ball_views(size=48)
    doubled = [camera.resized(96, 96) for camera in cameras]
    assert (visual_hull(doubled, alphas, 24).occupancy == visual_hull(cameras, alphas, 24).occupancy).all()


def test_outside_a_photo_is_unknown_not_empty():
    """A close-up sees a part of the object only; what it does not see stays."""
    cameras, alphas = ball_views(size=48)
    near = camera_at((0, 0.2, 3.0), size=48, focal=900)
    whole = visual_hull(cameras, alphas, 24)
    with_close_up = visual_hull([*cameras, near], [*alphas, np.ones((48, 48), np.float32)], 24)
    assert (with_close_up.occupancy == whole.occupancy).all()


def test_one_wrong_mask_of_many_changes_nothing():
    cameras = [camera_at(3.5 * np.array([np.cos(a), np.sin(a), 0.3])) for a in np.linspace(0, 6, 24)]
    alphas = [disc(camera, 0.7) for camera in cameras]
    whole = visual_hull(cameras, alphas, 24)
    alphas[3] = 1 - alphas[3]
    assert (visual_hull(cameras, alphas, 24).occupancy & whole.occupancy).sum() > 0.97 * whole.occupancy.sum()


def test_silhouette_of_single_voxels():
    """Every pixel whose ray meets the box of an occupied voxel, and no other."""
    occupancy = np.zeros((8, 8, 8), bool)
    occupancy[1, 2, 6] = occupancy[6, 5, 0] = occupancy[3, 3, 3] = True
    lo, hi = np.array([-1.0, -0.8, -1.2]), np.array([1.0, 0.8, 0.9])
    hull = Hull(occupancy, occupancy.astype(np.float32), lo, hi)
    for position in ((3, 1, 0.5), (0.5, -3, 1), (0.2, 0.1, 4), (0.1, 0.3, 0.05)):
        camera = camera_at(position, size=60, focal=70)
        v, u = np.mgrid[:60, :60] + 0.5
        local = np.stack([(u - camera.cx) / camera.fx, -(v - camera.cy) / camera.fy, -np.ones_like(u)], -1)
        rays = local @ camera.camera_to_world[:3, :3].T
        expected = np.zeros((60, 60), bool)
        for low in hull.centers(occupancy) - hull.voxel / 2:
            near, far = (low - camera.position) / rays, (low + hull.voxel - camera.position) / rays
            enter, leave = np.minimum(near, far).max(-1), np.maximum(near, far).min(-1)
            expected |= (leave > np.maximum(enter, 0)) & (leave - enter > 1e-6)
        assert (hull.silhouette(camera) != expected).sum() <= 1
        assert expected.any()


def test_empty_hull_has_an_empty_silhouette():
    empty = np.zeros((4, 4, 4), bool)
    hull = Hull(empty, empty.astype(np.float32), -np.ones(3), np.ones(3))
    assert not hull.silhouette(camera_at((3, 0, 1))).any()


def test_similarity_of_a_ball():
    similarity = find_similarity(*ball_views(radius=0.4, size=96, focal=180))
    np.testing.assert_allclose(similarity.center, 0, atol=0.03)
    assert similarity.scale == pytest.approx(0.4, rel=0.25)  # seven silhouettes leave corners


@pytest.mark.slow
def test_close_ups_do_not_move_the_object():
    """Two thirds of the photos crop the object; the similarity stays that of the whole views."""
    whole, close = views(24), views(24, zoom=4.0)
    cropped = [view if i % 3 == 0 else close[i] for i, view in enumerate(whole)]
    expected, found = (find_similarity(*worlds_cameras(shots)) for shots in (whole, cropped))
    np.testing.assert_allclose(found.center, expected.center, atol=0.08)
    assert found.scale == pytest.approx(expected.scale, rel=0.1)
    farthest = max(np.linalg.norm(np.array(center) - MIDDLE) + radius for center, radius, _ in BALLS)
    assert expected.scale == pytest.approx(farthest, rel=0.1)


def test_only_close_ups():
    """Not one photo shows the whole object."""
    cameras, alphas = worlds_cameras(views(40, zoom=2.6))
    similarity = find_similarity(cameras, alphas)
    np.testing.assert_allclose(similarity.center, MIDDLE, atol=0.35)
    assert 0.6 < similarity.scale < 1.6


def test_first_guess_survives_a_wrong_pose():
    cameras, alphas = ball_views()
    cameras[0] = camera_at((0, 3.5, 3.5), size=64)
    alphas[0] = np.roll(alphas[0], 14, axis=1)
    center, radius = first_guess(cameras, alphas)
    assert np.linalg.norm(center) < 0.05
    assert 0.6 < radius < 1.3


def test_cameras_that_look_away():
    cameras, alphas = ball_views()
    away = [camera_at(-camera.position) for camera in cameras]
    poses = [np.block([[c.camera_to_world[:, :3], -c.camera_to_world[:, 3:]]]) for c in away]
    moved = [replace(c, camera_to_world=pose) for c, pose in zip(away, poses, strict=True)]
    for camera in moved:
        camera.camera_to_world[3] = (0, 0, 0, 1)
    with pytest.raises(InputError, match="look away"):
        find_similarity(moved, alphas)


def test_a_hole_that_few_photos_look_through_is_open():
    """In 60 photos the hole of the ring is hidden or filled by a careless mask; three look through it."""
    cameras = [camera_at(3.5 * np.array([np.cos(a), np.sin(a), 0.1])) for a in np.linspace(0, 6, 60)]
    alphas = [disc(camera, 0.7) for camera in cameras]
    from_above = [camera_at(3.5 * np.array([0.1 * k, 0.1, 1.0])) for k in range(3)]
    rings = [disc(camera, 0.7) * (1 - disc(camera, 0.4)) for camera in from_above]
    hull = visual_hull([*cameras, *from_above], [*alphas, *rings], 24)
    assert not hull.occupancy[12, 12, 12]
    assert hull.occupancy[12 + 6, 12, 12]


def around(count: int) -> list:
    """Return cameras on two rings, above and below the equator."""
    turns = np.linspace(0, 6.2, count)
    return [camera_at(3.5 * np.array([np.cos(a), np.sin(a), 0.3 * (-1) ** k])) for k, a in enumerate(turns)]


def ball_of(cameras) -> list[np.ndarray]:
    return [disc(camera, 0.7) for camera in cameras]


def missed(hull, cameras) -> float:
    """Return the share of the ball's pixels that the hull's silhouettes do not cover."""
    pairs = [(disc(camera, 0.65) > 0, hull.silhouette(camera)) for camera in cameras]
    return sum((ball & ~seen).sum() for ball, seen in pairs) / sum(ball.sum() for ball, _ in pairs)


@pytest.mark.slow
def test_a_tunnel_that_two_of_many_photos_look_through_is_open():
    cameras = around(120)
    through = [camera_at(3.5 * np.array([0.1 * k, 0.1, 1.0])) for k in (0, 1)]
    alphas = ball_of(cameras) + [disc(camera, 0.7) * (1 - disc(camera, 0.3)) for camera in through]
    assert visual_hull([*cameras, *through], alphas, COUNT, **BOX).occupancy[CENTRAL]
    hull = carved_hull([*cameras, *through], alphas, COUNT, **BOX)
    assert not hull.occupancy[CENTRAL]
    assert missed(hull, cameras) < 0.01


def test_what_a_few_masks_miss_is_put_back():
    cameras = around(60)
    alphas = ball_of(cameras)
    for k in (5, 20, 35, 50):  # half of the object is missing
        alphas[k][:, :32] = 0
    assert missed(visual_hull(cameras, alphas, COUNT, **BOX, agreement=0.98), cameras) > 0.05
    hull = carved_hull(cameras, alphas, COUNT, **BOX)
    assert missed(hull, cameras) < 0.01
    assert hull.occupancy.sum() < 1.1 * visual_hull(cameras, ball_of(cameras), COUNT, **BOX).occupancy.sum()


def test_with_exact_masks_it_is_the_usual_hull():
    cameras = around(60)
    usual = visual_hull(cameras, ball_of(cameras), COUNT, **BOX).occupancy
    carved = carved_hull(cameras, ball_of(cameras), COUNT, **BOX).occupancy
    assert (usual ^ carved).sum() < 0.01 * usual.sum()


@pytest.mark.parametrize("empty", [0, 2])
def test_photos_without_the_object_say_nothing(empty):
    cameras = around(60)
    alphas = ball_of(cameras)
    for k in range(empty):
        alphas[k][:] = 0
    assert missed(carved_hull(cameras, alphas, COUNT, **BOX), cameras) < 0.01


def test_with_few_photos_every_mask_counts():
    cameras, alphas = ball_views()
    carved = carved_hull(cameras, alphas, COUNT, **BOX)
    assert np.array_equal(carved.occupancy, visual_hull(cameras, alphas, COUNT, **BOX).occupancy)

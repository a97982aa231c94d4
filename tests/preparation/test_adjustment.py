"""Cameras placed exactly from features that lie a pixel beside; wrong ones are found again or left out."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from lightprobe.preparation.adjustment import RIGHT, _moved_to_points, placed
from lightprobe.preparation.alignment import followed
from lightprobe.preparation.features import Features
from lightprobe.preparation.mapping import Solution
from tests.shapes import camera_at

pytest.importorskip("pycolmap")
cv2 = pytest.importorskip("cv2")
PHOTOS, SIZE, FOCAL = 9, 260, 420.0
PLANES = (np.eye(3), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))  # columns: across, up, out


@pytest.fixture(scope="module")
def corner():
    """Photos of two walls that meet, with features a pixel beside the points that they mark, and the truth."""
    rng = np.random.default_rng(3)
    textures = [scipy.ndimage.gaussian_filter(rng.normal(size=(400, 400)), 2.5) for _ in PLANES]
    textures = [np.clip(128 + 45 * each / each.std(), 0, 255).astype(np.float32) for each in textures]
    angles = np.radians(np.linspace(15, 75, PHOTOS))
    cameras = [camera_at((3 * np.sin(a), 0.5, 3 * np.cos(a)), size=SIZE, focal=FOCAL) for a in angles]
    pictures = [_photo(camera, textures) for camera in cameras]
    points = np.concatenate([rng.uniform(0.05, 0.9, (160, 3)) * [1, 1, 0] @ plane.T for plane in PLANES])
    points[:, 1] -= 0.45
    noisy = [each.project(points)[:, :2] + rng.normal(0, 1.0, (len(points), 2)) for each in cameras]
    photos = [Features(at.astype(np.float32), np.zeros((len(at), 0), np.uint8), SIZE, SIZE) for at in noisy]
    rows = np.repeat(np.arange(len(points), dtype=np.uint32)[:, None], 2, axis=1)
    matches = {
        (i, j): rows[rng.random(len(rows)) < 0.5]
        for i in range(PHOTOS)
        for j in range(i + 1, min(i + 4, PHOTOS))
    }
    return photos, matches, cameras, pictures


def _photo(camera, textures) -> np.ndarray:
    """Return the walls as a camera shows them, (H, W) uint8; both begin at the line where they meet."""
    rows, columns = np.mgrid[:SIZE, :SIZE] + 0.5
    rays = np.stack([(columns - SIZE / 2) / FOCAL, -(rows - SIZE / 2) / FOCAL, -np.ones((SIZE, SIZE))], -1)
    rays = rays @ camera.camera_to_world[:3, :3].T
    picture = np.full((SIZE, SIZE), 60, np.float32)
    for plane, texture in zip(PLANES, textures, strict=True):
        across, up, out = plane.T
        depth = -(camera.position @ out) / (rays @ out)
        hit = camera.position + depth[..., None] * rays
        u, v = hit @ across, hit @ up + 0.45
        inside = (depth > 0) & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        shown = scipy.ndimage.map_coordinates(texture, [v * 399, u * 399], order=1, mode="nearest")
        picture = np.where(inside, shown, picture)
    return picture.astype(np.uint8)


def _solution(cameras, degrees: float, wrong: int | None = None) -> Solution:
    """Return cameras that are turned about the object by some degrees, and one by much more; no points."""
    rng, poses = np.random.default_rng(5), []
    for index, camera in enumerate(cameras):
        angle = rng.normal(0, degrees) + (25 if index == wrong else 0)
        turn = np.eye(4)
        turn[:3, :3] = scipy.spatial.transform.Rotation.from_euler("y", angle, degrees=True).as_matrix()
        poses.append(turn @ camera.camera_to_world)
    count, none = len(cameras), np.zeros(0, int)
    lens = np.tile([FOCAL, SIZE / 2, SIZE / 2, 0.0], (count, 1))
    size = np.full((count, 2), SIZE)
    return Solution(
        np.arange(count), np.array(poses), lens, size, np.zeros((0, 3)), np.zeros(0), none, none, none
    )


def _errors(solution: Solution, cameras) -> np.ndarray:
    """Return the angles, in degrees, between neighbours' relative rotations and the true ones."""
    found, true = solution.pose[:, :3, :3], [cameras[k].camera_to_world[:3, :3] for k in solution.photo]
    turns = [(b.T @ a) @ (d.T @ c).T for a, b, c, d in zip(found, found[1:], true, true[1:], strict=False)]
    return np.degrees(np.arccos(np.clip([(np.trace(turn) - 1) / 2 for turn in turns], -1, 1)))


def test_cameras_are_placed_to_a_tenth_of_a_degree_by_points_that_all_photos_show(corner):
    photos, matches, cameras, pictures = corner
    found = placed(photos, matches, _solution(cameras, 0.7), pictures)
    assert _errors(_solution(cameras, 0.7), cameras).max() > 0.5
    assert _errors(found.solution, cameras).max() < 0.1
    assert np.bincount(found.solution.seen).max() > 5
    assert min(found.share.values()) > 0.4


def test_a_wrong_camera_shows_nothing_where_it_should_and_is_found_again(corner):
    photos, matches, cameras, pictures = corner
    start = _solution(cameras, 0.0)
    found = placed(photos, matches, start, pictures)
    poses = found.solution.pose.copy()
    poses[4] = _solution(cameras, 0.0, wrong=4).pose[4]
    share = followed(replace(found.solution, pose=poses), pictures, 4.0).share
    assert share[4] < RIGHT < 0.5 < share[3]
    again = placed(photos, matches, _solution(cameras, 0.0, wrong=4), pictures)
    assert list(again.solution.photo) == list(range(PHOTOS))
    assert _errors(again.solution, cameras).max() < 0.15


def test_a_photo_of_something_else_is_left_out(corner):
    photos, matches, cameras, pictures = corner
    noise = np.random.default_rng(0).integers(0, 255, (SIZE, SIZE)).astype(np.uint8)
    found = placed(photos, matches, _solution(cameras, 0.3), [*pictures[:-1], noise])
    assert list(found.solution.photo) == list(range(PHOTOS - 1))


def test_photos_that_agree_among_themselves_alone_are_left_out_as_a_group(corner):
    photos, matches, cameras, pictures = corner
    twice = range(4)  # once more, elsewhere in the world: without a match with the others
    among = {(i + PHOTOS, j + PHOTOS): rows for (i, j), rows in matches.items() if j in twice}
    start = _solution([*cameras, *(cameras[k] for k in twice)], 0.0)
    start.pose[PHOTOS:, :3, 3] += [8.0, 0, 0]
    found = placed(
        [*photos, *(photos[k] for k in twice)],
        matches | among,
        start,
        [*pictures, *(pictures[k] for k in twice)],
    )
    assert list(found.solution.photo) == list(range(PHOTOS))
    assert found.apart == (tuple(k + PHOTOS for k in twice),)


def test_a_photo_whose_pairs_were_not_matched_is_matched_and_placed_before_it_is_given_up(corner):
    photos, matches, cameras, pictures = corner
    none = np.zeros((0, 2), np.uint32)
    pairs = [(i, j) for i in range(PHOTOS) for j in range(i + 1, PHOTOS) if 4 not in (i, j)]
    known = {pair: matches.get(pair, none) for pair in pairs}
    start = _solution(cameras, 0.0)
    others = start.photo != 4
    start = replace(
        start, **{name: getattr(start, name)[others] for name in ("photo", "pose", "lens", "size")}
    )
    asked = []

    def match_more(pairs):
        asked.append(pairs)
        return {pair: matches.get(pair, none) for pair in pairs}

    assert 4 not in placed(photos, known, start, pictures).solution.photo
    found = placed(photos, known, start, pictures, match_more)
    assert asked == [[(0, 4), (1, 4), (2, 4), (3, 4), (4, 5), (4, 6), (4, 7), (4, 8)]]
    assert list(found.solution.photo) == list(range(PHOTOS))
    assert _errors(found.solution, cameras).max() < 0.15
    few = {pair: rows for pair, rows in known.items() if len(rows)}
    assert 4 not in placed(photos, few, start, pictures, match_more).solution.photo
    assert len(asked) == 1


def test_a_camera_that_is_nearly_right_is_moved_to_the_points_that_its_photo_shows(corner):
    photos, matches, cameras, pictures = corner
    found = placed(photos, matches, _solution(cameras, 0.0), pictures).solution
    off = found.pose.copy()
    off[4, :3, 3] += 0.04 * off[4, :3, 0]  # 5 pixels on the walls
    before = replace(found, pose=off)
    moved = _moved_to_points(before, pictures, 4)
    shown = [followed(each, pictures, 5.0, only=4).share[4] for each in (before, moved)]
    assert shown[0] < 0.5 < 0.9 < shown[1]
    assert np.linalg.norm(moved.pose[4, :3, 3] - found.pose[4, :3, 3]) < 0.01
    noise = np.random.default_rng(0).integers(0, 255, (SIZE, SIZE)).astype(np.uint8)
    assert _moved_to_points(before, [*pictures[:4], noise, *pictures[5:]], 4) is None

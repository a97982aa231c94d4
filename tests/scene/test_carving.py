import numpy as np
import pytest

from lightprobe.scene import carved_hull, visual_hull
from tests.scene.balls import ball_views, disc
from tests.shapes import camera_at

BOX = {"lo": (-1.05,) * 3, "hi": (1.05,) * 3}
COUNT = 24
MIDDLE = (COUNT // 2,) * 3


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
    assert visual_hull([*cameras, *through], alphas, COUNT, **BOX).occupancy[MIDDLE]
    hull = carved_hull([*cameras, *through], alphas, COUNT, **BOX)
    assert not hull.occupancy[MIDDLE]
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

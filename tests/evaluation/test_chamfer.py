import numpy as np
import pytest

from lightprobe.evaluation import chamfer
from lightprobe.evaluation.chamfer import chamfer_distance, mesh_chamfer, outer_faces, sample_surface
from tests.shapes import sphere

SQUARE = (np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))


def test_samples_lie_on_the_surface_evenly():
    points = sample_surface(*SQUARE, count=20000, seed=1)
    assert np.abs(points[:, 2]).max() == 0
    assert points.mean(0)[:2] == pytest.approx([1.0, 0.5], abs=0.02)
    counts, *_ = np.histogram2d(points[:, 0], points[:, 1], bins=(8, 4), range=((0, 2), (0, 1)))
    assert np.abs(counts / counts.mean() - 1).max() < 0.15


def test_distance_of_parallel_grids_is_their_gap():
    grid = np.stack(np.meshgrid(np.arange(10.0), np.arange(10.0), [0.0]), -1).reshape(-1, 3)
    assert chamfer_distance(grid, grid + np.array([0, 0, 0.25])) == pytest.approx(0.25)
    assert chamfer_distance(grid, grid) == 0


@pytest.mark.slow
def test_concentric_spheres_differ_by_their_radii_in_any_unit():
    vertices, faces = sphere(4)
    larger = 7.0 * vertices + [3.0, 1.0, -2.0]
    smaller = 0.9 * 7.0 * vertices + [3.0, 1.0, -2.0]
    assert mesh_chamfer((smaller, faces), (larger, faces), count=10_000) == pytest.approx(0.1, abs=0.005)


@pytest.mark.slow
def test_what_nobody_can_see_does_not_count():
    vertices, faces = sphere(3)
    both = np.concatenate([vertices, 0.5 * vertices])
    hidden = np.concatenate([faces, faces + len(vertices)])
    assert outer_faces(both, hidden).max() < len(faces)
    assert mesh_chamfer((both, hidden), (vertices, faces)) < 0.02


def test_the_distance_is_the_mean_of_both_ways_and_either_may_be_larger() -> None:
    one, two = np.zeros((1, 3)), np.array([[0.0, 0, 0], [0, 3, 4]])
    assert chamfer_distance(one, two) == pytest.approx((0 + 2.5) / 2)
    assert chamfer_distance(two + np.array([1.0, 0, 0]), one) == pytest.approx((1 + 26**0.5) / 2 / 2 + 1 / 2)


def test_samples_follow_area_and_stay_within_their_triangle() -> None:
    """A triangle of three quarters of the area far from one of a quarter, with edges that are not at right
    angles.
    """
    vertices = np.array([[0.0, 0, 0], [3, 1, 0], [2, 3, 0], [10, 0, 5], [12, 0, 5], [10, 7 / 6, 5]])
    points = sample_surface(vertices, np.array([[0, 1, 2], [3, 4, 5]]), count=8000, seed=2)
    here, there = points[points[:, 2] == 0], points[points[:, 2] == 5]
    assert len(here) + len(there) == 8000
    assert len(here) / 8000 == pytest.approx(0.75, abs=0.02)
    for cloud, (a, b, c) in ((here, vertices[:3]), (there, vertices[3:])):
        assert cloud.mean(0) == pytest.approx((a + b + c) / 3, abs=0.05)
        u, v = np.linalg.lstsq(np.stack([b - a, c - a], 1), (cloud - a).T, rcond=None)[0]
        assert min(u.min(), v.min()) >= -1e-9
        assert (u + v).max() <= 1 + 1e-9
        assert ((u + v) < 0.5).mean() == pytest.approx(0.25, abs=0.03)  # a similar triangle of half the size
    assert not np.array_equal(
        points, sample_surface(vertices, np.array([[0, 1, 2], [3, 4, 5]]), count=8000, seed=3)
    )


def test_the_same_surface_is_as_far_away_however_its_faces_are_listed():
    v, f = SQUARE
    one, other = (mesh_chamfer((v, faces), SQUARE, count=2000) for faces in (f, f[::-1]))
    assert one > 0.005
    assert one == pytest.approx(other, rel=0.2)


def test_both_meshes_are_looked_at_from_around_the_true_one_s_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    """The middle is that of the box, and the farthest vertex is at 1."""
    seen: list[np.ndarray] = []

    def every(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        seen.append(vertices)
        return np.arange(len(faces))

    monkeypatch.setattr(chamfer, "outer_faces", every)
    true = np.array([[1.0, 2, 3], [7, 2, 3], [1, 10, 3], [1, 2, 3.5], [1, 2, 3.5]])
    mine, faces = true + np.array([0.0, 0.0, 51.25]), np.array([[0, 1, 2]])
    distance = mesh_chamfer((mine, faces), (true, faces), count=50)
    radius = np.linalg.norm([3.0, 4.0, 0.25])
    assert seen[1] == pytest.approx((true - [4.0, 6.0, 3.25]) / radius)
    assert seen[0] == pytest.approx((mine - [4.0, 6.0, 3.25]) / radius)
    assert distance == pytest.approx(51.25 / radius, rel=1e-3)


def test_every_face_of_a_ball_can_be_seen() -> None:
    vertices, faces = sphere(2)
    assert outer_faces(vertices, faces).tolist() == list(range(len(faces)))

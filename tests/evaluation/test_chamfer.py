import numpy as np
import pytest

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


def test_concentric_spheres_differ_by_their_radii_in_any_unit():
    vertices, faces = sphere(4)
    larger = 7.0 * vertices + [3.0, 1.0, -2.0]
    smaller = 0.9 * 7.0 * vertices + [3.0, 1.0, -2.0]
    assert mesh_chamfer((smaller, faces), (larger, faces), count=10_000) == pytest.approx(0.1, abs=0.005)


def test_what_nobody_can_see_does_not_count():
    vertices, faces = sphere(3)
    both = np.concatenate([vertices, 0.5 * vertices])
    hidden = np.concatenate([faces, faces + len(vertices)])
    assert outer_faces(both, hidden).max() < len(faces)
    assert mesh_chamfer((both, hidden), (vertices, faces), count=5000) < 0.02

"""Shadows of a surface that has moved a little since they were found."""

import pytest
import torch

from lightprobe.reconstruction import moving_visibility
from lightprobe.reconstruction.moving_visibility import MovingVisibility, nearest_rows
from lightprobe.render.surface import View, visible_surface
from tests.shapes import camera_at, sphere


@pytest.mark.slow
def test_thin_parts_keep_their_sides_apart():
    """Two sheets closer than a cell: each takes over the visibility of its own side."""
    vertices, faces = (torch.from_numpy(part) for part in sphere(3))
    flat = vertices * torch.tensor([1.0, 1.0, 0.02])
    shadows = MovingVisibility.of(flat, faces, torch.full_like(flat, 0.5), 256)
    moved = flat + torch.tensor([0.01, 0.0, 0.015])
    view = View.of(camera_at([0.3, 0.0, 3.0]), torch.device("cpu"))
    surface = visible_surface(moved, faces, view)
    upward = torch.tensor([[0.0, 0.0, 1.0]]).expand(len(surface.pixel), 3)
    visibility = shadows.at(moved, faces, surface)
    assert float(visibility.towards(upward).mean()) > 0.95
    assert float(visibility.towards(-upward).mean()) < 0.1


@pytest.mark.parametrize("pairs", [1, 1000, 1 << 25])
def test_a_gpus_comparison_finds_what_the_tree_finds(monkeypatch, pairs):
    monkeypatch.setattr(moving_visibility, "_PAIRS", pairs)
    random = torch.Generator().manual_seed(0)
    stored, points = torch.randn(500, 6, generator=random), torch.randn(40, 6, generator=random)
    expected = torch.cdist(points, stored, compute_mode="donot_use_mm_for_euclid_dist").argmin(1)
    assert torch.equal(nearest_rows(points, stored), expected)


@pytest.mark.slow
def test_a_gpu_looks_up_the_same_openness_without_a_tree(monkeypatch):
    vertices, faces = (torch.from_numpy(part) for part in sphere(3))
    view = View.of(camera_at([0.3, 0.0, 3.0]), torch.device("cpu"))
    moved = 1.01 * vertices + torch.tensor([0.003, 0.001, -0.002])
    surface = visible_surface(moved, faces, view)
    usual = MovingVisibility.of(vertices, faces, torch.full_like(vertices, 0.5), 256).at(
        moved, faces, surface
    )
    monkeypatch.setattr(moving_visibility.scipy.spatial, "cKDTree", lambda points: None)
    shadows = MovingVisibility.of(vertices, faces, torch.full_like(vertices, 0.5), 256).brightened(0.5)
    assert torch.equal(shadows.at(moved, faces, surface).index, usual.index)

"""Shadows of a surface that has moved a little since they were found."""

import torch

from lightprobe.decompose.moving_shadows import MovingShadows
from lightprobe.render.surface import View, visible_surface
from tests.shapes import camera_at, sphere


def test_thin_parts_keep_their_sides_apart():
    """Two sheets closer than a cell: each takes over the openness of its own side."""
    vertices, faces = (torch.from_numpy(part) for part in sphere(3))
    flat = vertices * torch.tensor([1.0, 1.0, 0.02])
    shadows = MovingShadows.of(flat, faces, torch.full_like(flat, 0.5))
    moved = flat + torch.tensor([0.01, 0.0, 0.015])
    view = View.of(camera_at([0.3, 0.0, 3.0]), torch.device("cpu"))
    surface = visible_surface(moved, faces, view)
    upward = torch.tensor([[0.0, 0.0, 1.0]]).expand(len(surface.pixel), 3)
    openness = shadows.at(moved, faces, surface)
    assert float(openness.towards(upward).mean()) > 0.95
    assert float(openness.towards(-upward).mean()) < 0.1

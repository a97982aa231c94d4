"""Visible points: where they are, that they follow the vertices, and normals that must face the camera."""

from dataclasses import replace

import numpy as np
import torch

from lightprobe.render.surface import View, face_camera, visible_surface
from tests.shapes import camera_at, sphere

CPU = torch.device("cpu")


def unit_sphere(subdivisions):
    return tuple(torch.from_numpy(part) for part in sphere(subdivisions))


def exact(camera):
    """Return the view of a camera in float64."""
    view = View.of(camera, CPU)
    return replace(view, **{k: v.double() for k, v in vars(view).items() if isinstance(v, torch.Tensor)})


def test_position_and_view_of_visible_points():
    vertices, faces = unit_sphere(4)
    camera = camera_at([0.3, -3.0, 1.0], width=80)
    view = View.of(camera, CPU)
    surface = visible_surface(vertices, faces, view)
    projected = camera.project(surface.position.double().numpy())
    rows, columns = surface.pixel // 80, surface.pixel % 80
    assert abs(projected[:, 0] - columns.numpy() - 0.5).max() < 1e-3
    assert abs(projected[:, 1] - rows.numpy() - 0.5).max() < 1e-3
    assert (surface.position.norm(dim=1) - 1).abs().max() < 0.005
    assert ((surface.view * surface.position).sum(1) > -1e-2).all()


def test_projection_is_the_camera_s_and_rays_go_through_their_pixels():
    camera = camera_at([1.0, -2.0, 1.5], size=20, width=30)
    view = exact(camera)
    points = torch.randn(40, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    np.testing.assert_allclose(view.project(points).numpy(), camera.project(points.numpy()), rtol=1e-6)
    pixel = torch.arange(600)
    x, y, depth = view.project(view.position + 3 * view.rays(pixel)).unbind(1)
    found, centres = torch.stack([x, y], 1), torch.stack([pixel % 30, pixel // 30], 1) + 0.5
    torch.testing.assert_close(found, centres.double(), atol=1e-5, rtol=0)  # the rotation comes from float32
    torch.testing.assert_close(depth, torch.full_like(depth, 3), atol=1e-5, rtol=0)


def test_gradient_of_positions_and_views():
    """By finite differences in float64, as long as every pixel sees the same face."""
    vertices, faces = unit_sphere(1)
    view, start = exact(camera_at([2.0, 1.0, 1.0], size=10, focal=12.0)), vertices.double().requires_grad_()

    def seen(moved):
        surface = visible_surface(moved, faces, view)
        return torch.cat([surface.position, surface.view, surface.barycentric], 1)

    assert len(seen(start)) > 30
    assert torch.autograd.gradcheck(seen, (start,), eps=1e-7, atol=1e-6)


def test_interpolation_of_positions_is_the_position():
    vertices, faces = unit_sphere(2)
    surface = visible_surface(vertices, faces, View.of(camera_at([0.0, 3.0, 0.5]), CPU))
    torch.testing.assert_close(surface.interpolate(vertices, faces), surface.position)
    rows = torch.tensor([3, 0, 7])
    assert torch.equal(surface.select(rows).position, surface.position[rows])


def test_normals_that_look_away_are_bent_and_others_kept():
    random = torch.Generator().manual_seed(2)
    normal, to_camera = torch.nn.functional.normalize(torch.randn(2, 100, 3, generator=random), dim=-1)
    bent = face_camera(normal, to_camera)
    before, after = ((x * to_camera).sum(1) for x in (normal, bent))
    assert (after > -1e-6).all()
    torch.testing.assert_close(bent.norm(dim=1), torch.ones(100))
    kept = before > 0.1
    torch.testing.assert_close(bent[kept], normal[kept])
    assert kept.any()
    assert not kept.all()

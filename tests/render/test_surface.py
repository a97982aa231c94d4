"""Visible points: where they are, that they follow the vertices, and normals that must face the camera."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.render.surface import View, face_camera, visible_surface
from lightprobe.scene.camera import Camera
from tests.shapes import camera_at, sphere

CPU = torch.device("cpu")


def unit_sphere(subdivisions):
    return tuple(torch.from_numpy(part) for part in sphere(subdivisions))


def exact(camera):
    """Return the view of a camera in float64."""
    view = View.of(camera, CPU)
    return replace(view, **{k: v.double() for k, v in vars(view).items() if isinstance(v, torch.Tensor)})


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


@pytest.mark.slow
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


def test_a_normal_is_bent_until_the_view_s_cosine_was_a_fiftieth():
    view = torch.tensor([[1.0, 0.0, 0.0]]).expand(4, 3)
    normal = torch.tensor([[-0.6, 0.8, 0.0], [0.0, 0.0, -1.0], [0.019, 0.9998, 0.0], [0.021, 0.9998, 0.0]])
    expected = torch.tensor([[0.02, 0.8, 0.0], [0.02, 0.0, -1.0], [0.02, 0.9998, 0.0], [0.021, 0.9998, 0.0]])
    expected = expected / expected.norm(dim=1, keepdim=True)
    torch.testing.assert_close(face_camera(normal, view), expected, rtol=0, atol=1e-6)


def looking_down(width: int, height: int, lift: float) -> View:
    """Return a view from (.5, -.25, lift) along -z, +y up; a step of 1 is 10 px across, 20 px down, over depth."""
    pose = np.eye(4)
    pose[:3, 3] = 0.5, -0.25, lift
    return View.of(Camera(pose, 10.0, 20.0, 3.0, 2.5, width, height), CPU)


def test_pixels_depths_and_rays_by_hand():
    view = looking_down(7, 5, 2.0)
    points = torch.tensor([[0.5, -0.25, 0.0], [1.5, 0.25, 0.0], [1.5, 0.25, 3.0]])
    expected = [[3.0, 2.5, 2.0], [3.0 + 10 / 2, 2.5 - 20 * 0.5 / 2, 2.0], [3.0 - 10, 2.5 + 20 * 0.5, -1.0]]
    torch.testing.assert_close(view.project(points), torch.tensor(expected))
    rays = view.rays(torch.tensor([0, 9]))  # row 0, column 0, and row 1, column 2
    expected = [[(0.5 - 3) / 10, -(0.5 - 2.5) / 20, -1.0], [(2.5 - 3) / 10, -(1.5 - 2.5) / 20, -1.0]]
    torch.testing.assert_close(rays, torch.tensor(expected))


def test_a_point_beside_the_camera_has_a_finite_place():
    points = torch.tensor([[0.5, -0.25, 2.0], [1.5, -0.25, 2.0], [0.5, 0.75, 2.0]])
    found = looking_down(7, 5, 2.0).project(points)
    assert torch.isfinite(found).all()
    assert found[0].tolist() == [3.0, 2.5, 0.0]
    assert float(found[1, 0]) == pytest.approx(1e7, rel=1e-3)
    assert float(found[2, 1]) == pytest.approx(-2e7, rel=1e-3)


def test_of_two_triangles_a_pixel_sees_the_nearer_at_its_own_weights():
    """Weights are those of the corners in their order, at the pixel's centre on the plane of the face."""
    view = looking_down(7, 5, 2.0)
    near = torch.tensor([[0.0, -1.0, 0.5], [1.5, -1.0, 0.5], [0.0, 1.0, 0.5]])
    far = torch.tensor([[-9.0, -9.0, -1.0], [9.0, -9.0, -1.0], [0.0, 9.0, -1.0]])
    surface = visible_surface(torch.cat([far, near]), torch.tensor([[0, 1, 2], [3, 4, 5]]).int(), view)
    assert surface.pixel.tolist() == list(range(35))
    for k in range(35):
        x, y = (k % 7 + 0.5 - 3) / 10, -(k // 7 + 0.5 - 2.5) / 20
        at = 0.5 + 1.5 * x, -0.25 + 1.5 * y, 0.5
        v, w = at[0] / 1.5, (at[1] + 1) / 2
        if min(v, w, 1 - v - w) > 0:
            assert int(surface.face[k]) == 1
            assert surface.barycentric[k].tolist() == pytest.approx([1 - v - w, v, w], abs=1e-5)
        else:
            assert int(surface.face[k]) == 0
            at = 0.5 + 3 * x, -0.25 + 3 * y, -1.0
        to_camera = np.array([0.5, -0.25, 2.0]) - at
        to_camera = to_camera / np.linalg.norm(to_camera)
        assert surface.position[k].tolist() == pytest.approx(list(at), abs=1e-5)
        assert surface.view[k].tolist() == pytest.approx(list(to_camera), abs=1e-5)
    assert set(surface.face.tolist()) == {0, 1}


def test_points_stay_within_their_face_where_rounding_puts_the_centre_beside_it():
    """Weights are shares, of which none is negative and none above 1."""
    view, faces = looking_down(7, 5, 2.0), torch.tensor([[0, 1, 2]], dtype=torch.int32)
    centre = 0.6  # of the fourth column, at z = 0
    drawn, meant = (
        torch.tensor([[edge, -0.9, 0.0], [edge, 0.4, 0.0], [1.2, -0.2, 0.0]])
        for edge in (centre - 1e-3, centre + 1e-3)
    )
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1]):
        surface = visible_surface(meant[order], faces, view, view.project(drawn[order]))
        at_edge = surface.pixel % 7 == 3
        assert at_edge.sum() == 5
        edge = torch.full((5,), centre + 1e-3)
        torch.testing.assert_close(surface.position[at_edge, 0], edge, rtol=0, atol=1e-6)
        assert float(surface.barycentric.min()) >= 0
        assert float(surface.barycentric.max()) <= 1
        torch.testing.assert_close(surface.barycentric.sum(1), torch.ones(len(surface.pixel)))

import torch

from lightprobe.geometry.mesh import edge_faces
from lightprobe.render.silhouette import coverage, outline_vertices, silhouette_crossings, spread_color
from lightprobe.render.surface import View, visible_surface
from tests.shapes import camera_at, sphere


def covered(surface, picture):
    mask = torch.zeros(picture.height * picture.width, dtype=torch.bool)
    mask[surface.pixel] = True
    return mask.reshape(picture.height, picture.width)


def covered_area(vertices, faces, view):
    surface = visible_surface(vertices, faces, view)
    screen = view.project(vertices)
    crossings = silhouette_crossings(screen, faces, edge_faces(faces), surface.pixel, view)
    return coverage(surface.pixel, crossings, view.height * view.width), surface, crossings


def unit_sphere(subdivisions=3):
    return tuple(torch.from_numpy(a) for a in sphere(subdivisions))


def test_coverage_sums_to_the_area_of_the_outline():
    vertices, faces = unit_sphere(4)
    view = View.of(camera_at([3.0, 0.5, 0.3]), torch.device("cpu"))
    cover, _, _ = covered_area(vertices, faces, view)
    hull = supersampled(vertices, faces, camera_at([3.0, 0.5, 0.3]), 8)
    assert abs(float(cover.sum()) - hull.sum()) < 0.002 * hull.sum()
    assert (cover.reshape(64, 64) - hull).abs().mean() < 0.01


def supersampled(vertices, faces, camera, factor):
    fine = camera.resized(camera.width * factor, camera.height * factor)
    surface = visible_surface(vertices, faces, View.of(fine, torch.device("cpu")))
    mask = covered(surface, fine).float()
    return torch.nn.functional.avg_pool2d(mask[None], factor)[0]


def test_gradient_of_the_area_matches_finite_differences():
    vertices, faces = unit_sphere(3)
    view = View.of(camera_at([3.0, 0.0, 0.4]), torch.device("cpu"))
    scale = torch.tensor(1.0, requires_grad=True)
    cover, _, _ = covered_area(vertices * scale, faces, view)
    cover.sum().backward()
    step = 0.02
    fine = camera_at([3.0, 0.0, 0.4])
    high, low = (float(supersampled(vertices * s, faces, fine, 8).sum()) for s in (1 + step, 1 - step))
    numeric = (high - low) / (2 * step)
    assert abs(float(scale.grad) - numeric) < 0.03 * numeric


def test_gradient_moves_the_outline_sideways():
    vertices, faces = unit_sphere(3)
    view = View.of(camera_at([3.0, 0.0, 0.0]), torch.device("cpu"))
    shift = torch.zeros(3, requires_grad=True)
    cover, _, _ = covered_area(vertices + shift, faces, view)
    right_half = cover.reshape(64, 64)[:, 32:].sum()
    right_half.backward()
    # The camera at +x with z up has +y to its right.
    assert shift.grad[1] > 10
    assert abs(float(shift.grad[2])) < 0.1 * float(shift.grad[1])


def test_outline_pixels_repeat_the_colour_inside():
    vertices, faces = unit_sphere(3)
    view = View.of(camera_at([0.0, 3.0, 0.5], width=48), torch.device("cpu"))
    cover, surface, crossings = covered_area(vertices, faces, view)
    image = spread_color(torch.full((len(surface.pixel), 3), 0.25), surface.pixel, crossings, cover)
    assert torch.allclose(image, 0.25 * cover[:, None].expand(-1, 3), atol=1e-6)


def test_the_outline_needs_only_the_vertices_where_it_can_be():
    vertices, faces = unit_sphere(3)
    view = View.of(camera_at([3.0, 0.5, 0.3]), torch.device("cpu"))
    open_ball = faces[(vertices[faces.long()].mean(1) @ torch.tensor([0.3, 0.9, 0.3])) < 0.6]
    for some in (faces, open_ball, faces[:1]):
        screen = view.project(vertices)
        pixel = visible_surface(vertices, some, view).pixel
        chosen = outline_vertices(screen, some)
        every, few = (
            silhouette_crossings(screen, some, edges, pixel, view)
            for edges in (edge_faces(some), edge_faces(some, chosen))
        )
        assert chosen[some.long()].all(1).float().mean() < 0.3 or len(some) == 1
        for name in ("inner", "outer", "gain"):
            assert torch.equal(getattr(every, name), getattr(few, name))

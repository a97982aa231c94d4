from dataclasses import replace

import pytest
import torch

from lightprobe.geometry.mesh import edge_faces
from lightprobe.kernels import rasterize
from lightprobe.render import silhouette
from lightprobe.render.silhouette import Crossings, coverage, silhouette_crossings, spread_color
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


def test_the_outline_needs_only_the_vertices_where_it_can_be():
    vertices, faces = unit_sphere(3)
    view = View.of(camera_at([3.0, 0.5, 0.3]), torch.device("cpu"))
    open_ball = faces[(vertices[faces.long()].mean(1) @ torch.tensor([0.3, 0.9, 0.3])) < 0.6]
    for some in (faces, open_ball, faces[:1]):
        screen = view.project(vertices)
        pixel = visible_surface(vertices, some, view).pixel
        chosen = silhouette.outline_vertices(screen, some)
        every, few = (
            silhouette_crossings(screen, some, edges, pixel, view)
            for edges in (edge_faces(some), edge_faces(some, chosen))
        )
        assert chosen[some.long()].all(1).float().mean() < 0.3 or len(some) == 1
        for name in ("inner", "outer", "gain"):
            assert torch.equal(getattr(every, name), getattr(few, name))


def sheets(*outlines: list[tuple[float, float]]) -> tuple[torch.Tensor, torch.Tensor]:
    """Return projected vertices (4 K, 3) and faces (2 K, 3) of quadrilaterals that do not hang together."""
    screen = torch.tensor([(x, y, 1.0) for outline in outlines for x, y in outline])
    first = 4 * torch.arange(len(outlines))[:, None]
    return screen, torch.cat([first + torch.tensor(corners) for corners in ((0, 1, 2), (0, 2, 3))]).int()


def rectangle(left: float, top: float, right: float, bottom: float) -> list[tuple[float, float]]:
    return [(left, top), (right, top), (right, bottom), (left, bottom)]


def crossed(screen, faces, width: int, height: int) -> tuple[torch.Tensor, Crossings]:
    """Return which pixels the rasteriser covers (P,), and where the outline passes."""
    pixel = (rasterize(screen.detach(), faces, height, width).face.reshape(-1) >= 0).nonzero()[:, 0]
    view = replace(View.of(camera_at([3.0, 0.0, 0.0]), torch.device("cpu")), width=width, height=height)
    return pixel, silhouette_crossings(screen, faces, edge_faces(faces), pixel, view)


def shares(screen: torch.Tensor, faces: torch.Tensor, width: int, height: int) -> torch.Tensor:
    pixel, crossings = crossed(screen, faces, width, height)
    return coverage(pixel, crossings, width * height).reshape(height, width)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize(
    ("sides", "size", "expected"),
    [
        (  # amid the picture
            (1.3, 0.8, 5.2, 3.6),
            (7, 5),
            [
                [0, 0.2, 0.2, 0.2, 0.2, 0, 0],
                [0, 0.7, 1, 1, 1, 0.2, 0],
                [0, 0.7, 1, 1, 1, 0.2, 0],
                [0, 0.3, 0.6, 0.6, 0.6, 0.2, 0],
                [0] * 7,
            ],
        ),
        (  # ends on the outermost pixels
            (0.7, 0.6, 5.1, 3.3),
            (6, 4),
            [
                [0, 0.4, 0.4, 0.4, 0.4, 0],
                [0.3, 1, 1, 1, 1, 0.1],
                [0.3, 1, 1, 1, 1, 0.1],
                [0, 0.3, 0.3, 0.3, 0.3, 0],
            ],
        ),
        # goes on beyond the picture
        (
            (-2.7, -1.4, 3.3, 2.2),
            (6, 4),
            [[1, 1, 1, 0.3, 0, 0], [1, 1, 1, 0.3, 0, 0], [0.2] * 3 + [0] * 3, [0] * 6],
        ),
        (
            (2.6, 1.7, 9.0, 8.0),
            (6, 4),
            [[0] * 6, [0] * 3 + [0.3] * 3, [0, 0, 0.4, 1, 1, 1], [0, 0.0, 0.4, 1, 1, 1]],
        ),
        # between the last centres and the border, where there is no neighbour to share with
        ((3.9, 0.2, 5.8, 3.7), (6, 4), [[0, 0, 0, 0.1, 1, 1]] * 4),
        ((0.2, 2.9, 5.8, 3.8), (6, 4), [[0] * 6, [0] * 6, [0.1] * 6, [1] * 6]),
        # thinner than a pixel: both sides take from one
        ((2.3, -1.0, 2.9, 9.0), (5, 2), [[0, 0, 0.6, 0, 0]] * 2),
        ((-1.0, 1.2, 9.0, 1.9), (3, 4), [[0] * 3, [0.7] * 3, [0] * 3, [0] * 3]),
    ],
)
def test_beside_a_straight_edge_a_pixel_has_the_share_that_is_left(sides, size, expected, turn):
    screen, faces = sheets(rectangle(*sides)[::turn])
    found = shares(screen, faces, *size)
    torch.testing.assert_close(found, torch.tensor(expected).float(), rtol=0, atol=1e-5)


def overlap(low: float, high: float, count: int) -> list[float]:
    """Return the share (count,) of each unit interval that [low, high] covers."""
    return [max(0.0, min(high, j + 1) - max(low, j)) for j in range(count)]


@pytest.mark.parametrize("swapped", [False, True])
def test_along_a_slanted_edge_the_share_is_that_at_the_middle_of_the_row(swapped):
    outline = [(1.2, -1.0), (4.6, -1.0), (5.4, 7.0), (2.9, 7.0)]
    rows = [(y + 1) / 8 for y in (0.5, 1.5, 2.5, 3.5, 4.5)]
    expected = [overlap(1.2 + 1.7 * row, 4.6 + 0.8 * row, 7) for row in rows]
    upright = sheets(outline if not swapped else [(y, x) for x, y in outline])
    found = shares(*upright, 5, 7).T if swapped else shares(*upright, 7, 5)
    torch.testing.assert_close(found, torch.tensor(expected), rtol=0, atol=1e-5)


def test_edges_at_45_degrees_are_followed_from_row_to_row():
    x, y, radius = 3.25, 3.125, 2.75
    outline = [(x - radius, y), (x, y - radius), (x + radius, y), (x, y + radius)]
    half = [radius - abs(row + 0.5 - y) for row in range(7)]
    expected = [overlap(x - h, x + h, 7) if h > 0.2 else [0.0] * 7 for h in half]  # its tips miss all centres
    torch.testing.assert_close(shares(*sheets(outline), 7, 7), torch.tensor(expected), rtol=0, atol=1e-5)


def test_between_two_sheets_a_pixel_has_of_both_and_of_either_s_colour():
    screen, faces = sheets(rectangle(-1, -1, 2.2, 9), rectangle(2.9, -1, 9, 9))
    pixel, crossings = crossed(screen, faces, 5, 3)
    cover = coverage(pixel, crossings, 15)
    expected = torch.tensor([[1, 1, 0.3, 1, 1]]).expand(3, 5)
    torch.testing.assert_close(cover.reshape(3, 5), expected, rtol=0, atol=1e-5)
    radiance = torch.tensor([[5.0, 1.0], [5.0, 1.0], [2.0, 7.0], [2.0, 7.0]]).repeat(3, 1)
    image = spread_color(radiance, pixel, crossings, cover).reshape(3, 5, 2)
    mixed = [0.2 * 5 + 0.1 * 2, 0.2 * 1 + 0.1 * 7]
    expected = torch.tensor([[5.0, 1.0], [5.0, 1.0], mixed, [2.0, 7.0], [2.0, 7.0]]).expand(3, 5, 2)
    torch.testing.assert_close(image, expected, rtol=0, atol=1e-5)


def test_of_several_edges_between_two_pixels_the_outermost_counts():
    near, far = rectangle(-1, -1, 3.7, 1.9), rectangle(-1, -1, 4.2, 2.0)
    for outlines in ((near, far), (far, near)):
        cover = shares(*sheets(*outlines), 5, 5)
        expected = [[1, 1, 1, 1, 0.2]] * 2 + [[0] * 5] * 3
        torch.testing.assert_close(cover, torch.tensor(expected).float(), rtol=0, atol=1e-5)


def test_an_edge_with_an_end_behind_the_camera_is_no_outline():
    screen, faces = sheets(rectangle(1.3, 0.8, 5.2, 3.6))
    screen[0, 2] = -1.0  # top left: the top and the left edge end there
    pixel = torch.tensor([7 * row + column for row in (1, 2, 3) for column in (1, 2, 3, 4)])
    view = replace(View.of(camera_at([3.0, 0.0, 0.0]), torch.device("cpu")), width=7, height=5)
    crossings = silhouette_crossings(screen, faces, edge_faces(faces), pixel, view)
    found = coverage(pixel, crossings, 35).reshape(5, 7)
    expected = [[0] * 7, [0, 1, 1, 1, 1, 0.2, 0], [0, 1, 1, 1, 1, 0.2, 0], [0, *[0.6] * 4, 0.2, 0], [0] * 7]
    torch.testing.assert_close(found, torch.tensor(expected).float(), rtol=0, atol=1e-5)


def test_an_edge_exactly_through_centres_belongs_to_the_lines_from_its_upper_end_on():
    screen, faces = sheets(rectangle(1.3, 0.5, 3.2, 2.5))
    pixel = torch.tensor([5 * row + column for row in range(4) for column in (1, 2)])
    view = replace(View.of(camera_at([3.0, 0.0, 0.0]), torch.device("cpu")), width=5, height=4)
    crossings = silhouette_crossings(screen, faces, edge_faces(faces), pixel, view)
    found = sorted(zip(crossings.inner.tolist(), crossings.outer.tolist(), strict=True))
    assert found == [(1, 0), (2, 3), (6, 5), (7, 8)]


def test_coverage_never_leaves_0_to_1():
    gain = torch.tensor([-0.5, -0.4, -0.3, 0.5, 0.4, 0.3, 0.25, -0.25])
    inner, outer = torch.tensor([0, 0, 0, 1, 1, 1, 2, 3]), torch.tensor([4, 4, 4, 5, 5, 5, 6, 6])
    cover = coverage(torch.arange(4), Crossings(inner, outer, gain), 8)
    assert cover.tolist() == [0, 1, 1, 0.75, 0, 1, 0.25, 0]


def test_moving_an_edge_by_a_pixel_changes_the_area_by_its_length_in_rows():
    """Where the outline gives to a neighbour as where it takes from a pixel; nothing else moves with it."""
    screen, faces = sheets(rectangle(1.3, 0.8, 5.2, 3.6))
    screen.requires_grad_()
    shares(screen, faces, 7, 5).sum().backward()
    rows, columns = 3, 4  # centres within
    slope = screen.grad
    assert slope[[1, 2], 0].sum() == pytest.approx(rows)
    assert slope[[0, 3], 0].sum() == pytest.approx(-rows)
    assert slope[[2, 3], 1].sum() == pytest.approx(columns)
    assert slope[[0, 1], 1].sum() == pytest.approx(-columns)

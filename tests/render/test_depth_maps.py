"""Depth maps: axes that are right-handed, and points blocked by what stands before them and by nothing else."""

import math

import pytest
import torch

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.render.depth_maps import DepthMaps, frames
from tests.shapes import sphere


def directions(count=50):
    random = torch.Generator().manual_seed(0)
    axes = torch.cat([torch.eye(3), -torch.eye(3)])
    every = torch.cat([axes, torch.randn(count - 6, 3, generator=random)])
    return torch.nn.functional.normalize(every, dim=1)


def test_frames_are_rotations_onto_the_direction():
    towards = directions()
    axes = frames(towards)
    torch.testing.assert_close(axes @ axes.mT, torch.eye(3).expand(50, 3, 3), atol=1e-6, rtol=0)
    torch.testing.assert_close(torch.linalg.det(axes), torch.ones(50))
    assert torch.equal(axes[:, 2], towards)


def test_of_a_ball_the_side_towards_the_light_is_lit():
    vertices, faces = (torch.from_numpy(part) for part in sphere(3))
    normals = vertex_normals(vertices, faces)
    maps = DepthMaps.of(vertices, faces, vertices, normals, 256)
    for axes in frames(directions(8)):
        lit, before = maps.visibility(axes)
        cosine = normals @ axes[2]
        assert (lit[cosine > 0.1] > 0.999).all()
        assert (lit[cosine < -0.3] < 0.001).all()
        assert (before[cosine < -0.3] >= 0).all()


def test_an_open_mesh_and_a_closed_one_block_alike():
    """Of a closed mesh only the faces that look at the light are drawn."""
    vertices, faces = (torch.from_numpy(part) for part in sphere(3))
    normals = vertex_normals(vertices, faces)
    closed, opened = (DepthMaps.of(vertices, f, vertices, normals, 256) for f in (faces, faces[:-1]))
    assert closed.outward is not None
    assert opened.outward is None
    for axes in frames(directions(8)):
        one, other = closed.visibility(axes)[0], opened.visibility(axes)[0]
        assert (one != other).float().mean() < 0.01


AXES = torch.tensor([[0.6, 0.0, -0.8], [0.48, 0.8, 0.36], [0.64, -0.6, 0.48]])  # across, down, to the light
EXTENT, SIDE, PIXEL = 2.0, 16, 0.25
LEFT, RIGHT, TOP, BOTTOM, HEIGHT = -0.55, 0.35, -0.3, 0.8, 1.3  # of a sheet before the origin, in these axes


def sheet() -> tuple[torch.Tensor, torch.Tensor]:
    """Return vertices and faces of the sheet; a vertex of no face makes the maps 4 units wide."""
    corners = [(LEFT, TOP, HEIGHT), (RIGHT, TOP, HEIGHT), (RIGHT, BOTTOM, HEIGHT), (LEFT, BOTTOM, HEIGHT)]
    local = torch.tensor([*corners, (0.0, 0.0, -EXTENT / 1.02)])
    return local @ AXES, torch.tensor([[0, 1, 2], [0, 2, 3]], dtype=torch.int32)


def seen_from(points: torch.Tensor, normals: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return what the maps of the sheet say of points and normals (P, 3) in its axes."""
    vertices, faces = sheet()
    return DepthMaps.of(vertices, faces, points @ AXES, normals @ AXES, SIDE).visibility(AXES)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, -0.8, 0.6)])
def test_a_point_is_as_open_as_the_four_pixels_around_it(normal):
    """And the face before it is that of the nearest of the four."""
    random = torch.Generator().manual_seed(5)
    points = torch.cat([2.4 * torch.rand(200, 2, generator=random) - 1.2, torch.zeros(200, 1)], 1)
    lit, face = seen_from(points, torch.tensor(normal).expand(200, 3))

    def hit(column: int, row: int) -> int:
        x, y = ((n + 0.5) * PIXEL - EXTENT for n in (column, row))
        if not (LEFT < x < RIGHT and TOP < y < BOTTOM):
            return -1
        return int((y - TOP) * (RIGHT - LEFT) > (x - LEFT) * (BOTTOM - TOP))  # below the diagonal

    for k, point in enumerate(points.tolist()):
        x, y = ((point[axis] + 1.5 * PIXEL * normal[axis] + EXTENT) / PIXEL - 0.5 for axis in (0, 1))
        column, row = math.floor(x), math.floor(y)
        fx, fy = x - column, y - row
        shares = {(0, 0): (1 - fx) * (1 - fy), (1, 0): fx * (1 - fy), (0, 1): (1 - fx) * fy, (1, 1): fx * fy}
        expected = sum(share for (i, j), share in shares.items() if hit(column + i, row + j) < 0)
        assert float(lit[k]) == pytest.approx(expected, abs=1e-4)
        assert int(face[k]) == hit(column + (fx > 0.5), row + (fy > 0.5))
    assert set(face.tolist()) == {-1, 0, 1}


@pytest.mark.parametrize(
    ("normal", "bias"), [((0.0, 0.0, 1.0), 3.0), ((1.0, 0.0, 0.0), 1.5), ((0.0, 0.0, -1.0), 0.0)]
)
def test_what_is_nearer_than_the_lift_and_a_bias_of_one_and_a_half_pixels_blocks_nothing(normal, bias):
    for away, open_share in ((bias - 0.1, 1.0), (bias + 0.1, 0.0)):
        point = torch.tensor([[-0.35, 0.1, HEIGHT - away * PIXEL]])
        lit, face = seen_from(point, torch.tensor([normal]))
        assert float(lit) == open_share
        assert int(face) >= 0


def test_beyond_the_maps_nothing_blocks():
    corners = torch.tensor([[x, y, 0.0] for x in (-9.0, 9.0) for y in (-9.0, 9.0)])
    lit, face = seen_from(corners, torch.tensor([0.0, 0, 1]).expand(4, 3))
    assert lit.tolist() == [1, 1, 1, 1]
    assert face.tolist() == [-1, -1, -1, -1]


def test_of_a_closed_slab_the_face_before_a_point_is_one_that_looks_at_the_light():
    """By its number among all faces of the mesh; those that look away are not drawn."""
    low, high = torch.tensor([-0.5, -0.5, 0.6]), torch.tensor([0.5, 0.5, 1.1])
    local = torch.tensor([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]  # top last
    faces = torch.tensor([tri for a, b, c, d in quads for tri in ((a, b, c), (a, c, d))], dtype=torch.int32)
    point, normal = torch.tensor([[0.1, -0.2, 0.0]]), torch.tensor([[0.0, 0, 1]])
    maps = DepthMaps.of(local @ AXES, faces, point @ AXES, normal @ AXES, 64)
    assert maps.outward is not None
    for axes, numbers in ((AXES, {10, 11}), (AXES * torch.tensor([[-1.0], [1.0], [-1.0]]), {8, 9})):
        lit, face = maps.visibility(axes)
        assert float(lit) == float(numbers == {8, 9})  # these lie behind the point
        assert int(face) in numbers

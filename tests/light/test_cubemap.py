"""Texels of a cubemap: where each lies, how large it is, which ones touch, and what a look-up mixes.

What is expected is written from OpenGL's table of faces, with right angles and pyramids, or found among all
texels.
"""

import itertools
import math

import pytest
import torch
from torch import Tensor

from lightprobe.light import cubemap

CPU = torch.device("cpu")
POINTS = {  # of each face at a = 1/4 along its columns and b = -1/2 along its rows
    0: (1, 0.5, -0.25),
    1: (-1, 0.5, 0.25),
    2: (0.25, 1, -0.5),
    3: (0.25, -1, 0.5),
    4: (0.25, 0.5, 1),
    5: (-0.25, 0.5, -1),
}


@pytest.mark.parametrize(("face", "point"), POINTS.items())
@pytest.mark.parametrize("length", [0.1, 1, 30])
def test_a_point_of_a_face_has_the_direction_of_the_table_and_the_direction_that_point(
    face: int, point: tuple[float, float, float], length: float
) -> None:
    a, b = torch.tensor([0.25], dtype=torch.float64), torch.tensor([-0.5], dtype=torch.float64)
    assert cubemap.face_points(torch.tensor([face]), a, b).tolist() == [list(point)]
    found = cubemap.face_coordinates(length * torch.tensor([[point]]))
    assert [part.shape for part in found] == [(1, 1)] * 3
    assert [float(part) for part in found] == pytest.approx([face, 0.25, -0.5])


def test_an_edge_belongs_to_the_first_axis_of_those_that_meet_there() -> None:
    corners = {
        (2, 2, 1): 0,
        (-2, 2, 2): 1,
        (2, 1, -2): 0,
        (1, 2, 2): 2,
        (1, -2, 2): 3,
        (1, 1, 2): 4,
        (1, 1, -2): 5,
    }
    found = cubemap.face_coordinates(torch.tensor(list(corners), dtype=torch.float32))[0]
    assert found.tolist() == list(corners.values())


def test_columns_and_rows_have_their_centres_in_the_middle_of_equal_parts() -> None:
    face, a, b = cubemap.texel_grid(4)
    assert (face.dtype, a.dtype, a.shape) == (torch.int64, torch.float64, (6, 4, 4))
    assert face[:, 3, 0].tolist() == [0, 1, 2, 3, 4, 5]
    assert a[2, 1].tolist() == b[5, :, 2].tolist() == [-0.75, -0.25, 0.25, 0.75]
    towards = cubemap.exact_directions(4)
    assert towards.dtype == torch.float64
    assert towards[0, 1, 3].tolist() == pytest.approx([x / math.sqrt(1.625) for x in (1, 0.25, -0.75)])
    assert torch.equal(cubemap.directions(4), towards.float())


def test_a_solid_angle_is_that_of_a_pyramid() -> None:
    """A square pyramid of half width h at distance 1 has 4 asin(h^2 / (1 + h^2))."""

    def pyramid(h: float) -> float:
        return 4 * math.asin(h * h / (1 + h * h))

    exact = cubemap.exact_solid_angles(3)
    assert (exact.dtype, exact.shape) == (torch.float64, (6, 3, 3))
    assert cubemap.exact_solid_angles(1).flatten().tolist() == pytest.approx([4 * math.pi / 6] * 6)
    assert exact[:, 1, 1].tolist() == pytest.approx([pyramid(1 / 3)] * 6)
    assert exact.sum((1, 2)).tolist() == pytest.approx([pyramid(1)] * 6)
    inner = cubemap.exact_solid_angles(4)[3, 1:3, 1:3]
    assert inner.flatten().tolist() == pytest.approx([pyramid(0.5) / 4] * 4)
    assert torch.equal(cubemap.solid_angles(3), exact.float())


def test_a_mean_over_the_sphere_is_weighted_by_solid_angle() -> None:
    towards = cubemap.directions(32)
    values = torch.stack([towards[..., 2] ** 2, towards[..., 0] ** 4, 3 + towards[..., 1]], -1)
    squares = cubemap.sphere_mean(values)
    assert squares.tolist() == pytest.approx([1 / 3, 1 / 5, 3], rel=1e-3)
    assert float(cubemap.sphere_mean(towards[..., 2].abs())) == pytest.approx(0.5, rel=1e-3)
    faces = torch.arange(6.0)[:, None, None].expand(6, 2, 2)
    assert float(cubemap.sphere_mean(faces)) == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("place", "texel"), [(-0.99, 0), (-0.51, 0), (-0.49, 1), (0, 2), (0.49, 2), (0.51, 3)]
)
def test_the_texel_that_holds_a_direction_is_found(place: float, texel: int) -> None:
    """On +z, (a, b) points along (a, -b, 1)."""
    along = cubemap.nearest_texel(torch.tensor([0.9 * place, 0.6, 0.9]), 4)  # b = -2/3: the first row
    down = cubemap.nearest_texel(torch.tensor([-0.4, -0.8 * place, 0.8]), 4)  # a = -1/2: the second column
    assert (int(along), int(down)) == (16 * 4 + texel, 16 * 4 + 4 * texel + 1)


def test_a_corner_of_the_cube_belongs_to_a_corner_s_texel() -> None:
    corners = torch.tensor([[1.0, 1, 1], [1, -1, -1], [1, 1, -1], [-1, -1, 1]])
    assert cubemap.nearest_texel(corners, 4).tolist() == [0, 15, 3, 16 + 15]


def across(face: int, edge: str, place: float, resolution: int) -> int:
    """Return the texel of another face that is closest to the middle of a texel's outer edge."""
    at = torch.tensor([place]), torch.tensor([-1.0 if edge in ("left", "top") else 1.0])
    a, b = at[::-1] if edge in ("left", "right") else at
    point = cubemap.face_points(torch.tensor([face]), a, b)[0].double()
    cosine = cubemap.exact_directions(resolution) @ point
    cosine[face] = -9.0
    return int(cosine.argmax())


@pytest.mark.parametrize("resolution", [2, 4])
def test_a_border_holds_the_texel_across_the_edge(resolution: int) -> None:
    n = resolution
    padded = cubemap.padding(n, CPU).reshape(6, n + 2, n + 2)
    assert torch.equal(padded[:, 1:-1, 1:-1], torch.arange(6 * n * n).reshape(6, n, n))
    for face in range(6):
        for k in range(n):
            place = (2 * k + 1) / n - 1
            rows, columns = padded[face, k + 1, [0, -1]].tolist(), padded[face, [0, -1], k + 1].tolist()
            borders = rows + columns
            for found, edge in zip(borders, ("left", "right", "top", "bottom"), strict=True):
                assert int(found) == across(face, edge, place, n)
        for row in (0, -1):
            for column in (0, -1):
                inner_row, inner_column = (1 if end == 0 else -2 for end in (row, column))
                beside = padded[face, row, inner_column], padded[face, inner_row, column]
                assert padded[face, row, column] in beside


@pytest.mark.parametrize("resolution", [2, 4])
def test_cells_are_the_quartets_of_a_padded_face_without_its_corners(resolution: int) -> None:
    padded = cubemap.padding(resolution, CPU).reshape(6, resolution + 2, resolution + 2).clone()
    for row in (0, -1):
        for column in (0, -1):
            padded[:, row, column] = -1
    upper, lower = padded[:, :-1], padded[:, 1:]
    quartets = torch.stack([upper[..., :-1], upper[..., 1:], lower[..., :-1], lower[..., 1:]], -1)
    found = cubemap.cells(resolution, CPU)
    assert found.dtype == torch.int32
    assert torch.equal(found.long(), quartets.reshape(-1, 4))


def looked_up(cube: Tensor, direction: Tensor) -> Tensor:
    index, weight = cubemap.bilinear_taps(direction, cube.shape[1])
    assert index.min() >= 0
    assert weight.min() >= 0
    torch.testing.assert_close(weight.sum(1), torch.ones_like(weight[:, 0]))
    return (cube.reshape(-1)[index.long()] * weight).sum(1)


def test_every_edge_looks_the_same_from_both_sides() -> None:
    cube = torch.rand(6, 4, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    along = torch.linspace(-0.97, 0.97, 21, dtype=torch.float64)
    sides: list[Tensor] = []
    for free, x, y in itertools.product(range(3), (1.0, -1.0), (1.0, -1.0)):
        for over in (1e-7, -1e-7):
            edge = torch.stack([along, torch.full_like(along, x + x * over), torch.full_like(along, y)], 1)
            sides.append(edge.roll(free, 1))
    one, other = (looked_up(cube, torch.cat(sides[k::2])) for k in (0, 1))
    torch.testing.assert_close(one, other, rtol=0, atol=1e-5)


def test_where_three_faces_meet_their_three_texels_count_alike() -> None:
    for x, y, z in itertools.product((1.0, -1.0), repeat=3):
        corner = torch.tensor([[1.001 * x, y, z], [x, 1.001 * y, z], [x, y, 1.001 * z]], dtype=torch.float64)
        index, weight = cubemap.bilinear_taps(corner, 4)
        nearest = (cubemap.exact_directions(4).reshape(-1, 3) @ corner[0].sign()).topk(3).indices
        for k in range(3):
            total = torch.zeros(96, dtype=torch.float64).index_add_(0, index[k].long(), weight[k])
            assert total[nearest].tolist() == pytest.approx([1 / 3] * 3, abs=2e-3)


def test_a_missing_texel_s_weight_goes_to_the_other_three_in_equal_parts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At a = b = 3/4 of +z, a quarter beyond the centre of the last of two texels."""
    direction = torch.tensor([[0.75, -0.75, 1.0], [0.25, 0.0, 1.0]])
    for on_cpu in (True, False):
        monkeypatch.setattr(cubemap, "_on_cpu", lambda tensor, answer=on_cpu: answer)
        index, weight = cubemap.bilinear_taps(direction, 2)
        assert index.min() >= 0
        assert int(index[0, 0]) == 4 * 4 + 3
        assert weight[0].tolist() == pytest.approx([(27 + 1) / 48, (9 + 1) / 48, (9 + 1) / 48, 0])
        assert index[1].tolist() == [16, 17, 18, 19]
        assert weight[1].tolist() == pytest.approx([0.125, 0.375, 0.125, 0.375])


def test_rows_may_look_into_cubemaps_of_their_own_and_with_a_scale_of_their_own() -> None:
    direction = torch.tensor([[0.3, -0.5, 0.9], [1.0, 0.999, -0.998], [-0.2, -1.0, 0.7]])
    table = torch.cat([cubemap.cells(2, CPU), cubemap.cells(8, CPU)])
    resolution, start = torch.tensor([8, 2, 8]), torch.tensor([6 * 9, 0, 6 * 9])
    scale = torch.tensor([1.0, 0.5, 3.0])
    coordinates = cubemap.face_coordinates(direction)
    index, weight = cubemap.cell_taps(coordinates, resolution, start, table, scale)
    for k in range(3):
        own_index, own_weight = cubemap.bilinear_taps(direction[k : k + 1], int(resolution[k]))
        assert torch.equal(index[k], own_index[0])
        torch.testing.assert_close(weight[k], scale[k] * own_weight[0])


def test_the_cube_has_24_rotations_and_24_reflections():
    index, handedness = cubemap.symmetries(4, torch.device("cpu"))
    texels = cubemap.exact_directions(4).reshape(-1, 3)
    assert int((handedness == 1).sum()) == int((handedness == -1).sum()) == 24
    assert len(index.unique(dim=0)) == 48
    for turn, hand in zip(index, handedness, strict=True):
        matrix = torch.linalg.lstsq(texels, texels[turn]).solution
        torch.testing.assert_close(matrix @ matrix.T, torch.eye(3, dtype=torch.float64))
        torch.testing.assert_close(texels @ matrix, texels[turn])
        assert torch.linalg.det(matrix).round() == hand


def test_tap_weights_follow_their_direction():
    direction = torch.tensor([[0.3, -0.5, 0.9], [1.0, 0.2, -0.1]], dtype=torch.float64, requires_grad=True)
    cube = torch.rand(6, 8, 8, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda d: looked_up(cube, d), (direction,), eps=1e-6, atol=1e-5)

"""Rasteriser: against the plain reference and exact arithmetic, no holes, and rules for depth and odd faces."""

import math
from fractions import Fraction

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from lightprobe.kernels import rasterize
from lightprobe.kernels.reference import rasterize as reference
from tests.shapes import sphere
from tests.threads import assert_same_bits


def soup(count, height, width, *, seed=0, size=12.0):
    """Return `count` random triangles (3 count, 3), (count, 3), some of them partly or wholly off screen."""
    random = torch.Generator().manual_seed(seed)
    centre = torch.rand(count, 1, 2, generator=random) * torch.tensor([width + 10.0, height + 10.0]) - 5
    corners = centre + size * (torch.rand(count, 3, 2, generator=random) - 0.5)
    depth = 1 + torch.rand(count, 3, 1, generator=random)
    return torch.cat([corners, depth], dim=2).reshape(-1, 3), torch.arange(3 * count).reshape(-1, 3).int()


def sheet(cells, low, high, *, jitter=0.0, snap=False, seed=0):
    """Return a flat triangulated square from `low` to `high` pixels, inner vertices moved by `jitter` cells."""
    random = torch.Generator().manual_seed(seed)
    step = (high - low) / cells
    line = low + step * torch.arange(cells + 1)
    y, x = torch.meshgrid(line, line, indexing="ij")
    points = torch.stack([x, y, torch.ones_like(x)], dim=2)
    move = (torch.rand(cells - 1, cells - 1, 2, generator=random) * 2 - 1) * jitter * step
    points[1:-1, 1:-1, :2] += move
    if snap:
        points[..., :2] = torch.floor(points[..., :2]) + 0.5  # onto pixel centres
    i, j = torch.meshgrid(torch.arange(cells), torch.arange(cells), indexing="ij")
    a = (i * (cells + 1) + j).flatten()
    b, c, d = a + 1, a + cells + 1, a + cells + 2
    flip = torch.rand(cells * cells, 1, generator=random) < 0.5  # both diagonals, and both windings
    first = torch.where(flip, torch.stack([a, b, d], 1), torch.stack([b, a, c], 1))
    second = torch.where(flip, torch.stack([a, d, c], 1), torch.stack([b, c, d], 1))
    return points.reshape(-1, 3), torch.cat([first, second]).int()


@pytest.mark.parametrize(("height", "width"), [(64, 64), (37, 90), (100, 17), (1, 1)])
def test_equals_the_reference_to_the_bit(backend, height, width):
    cases = {12.0: backend.size(400, 40), 150.0: backend.size(30, 9), 1.5: backend.size(2000, 90), 1.0: 0}
    for size, count in cases.items():
        screen, faces = backend.move(*soup(count, height, width, size=size))
        seen = rasterize(screen, faces, height, width)
        face, inverse_depth = reference.rasterize(screen, faces, height, width)
        assert seen.face.shape == (height, width)
        assert torch.equal(seen.face, face)
        assert torch.equal(seen.inverse_depth, inverse_depth)


def covers_exactly(corners, x, y):
    """Return whether a point lies in or on a triangle, in rational arithmetic."""
    (ax, ay), (bx, by), (cx, cy) = [(Fraction(float(p[0])), Fraction(float(p[1]))) for p in corners]
    edges = [
        (qx - px) * (y - py) - (qy - py) * (x - px)
        for px, py, qx, qy in [(ax, ay, bx, by), (bx, by, cx, cy), (cx, cy, ax, ay)]
    ]
    return any(edges) and (all(e >= 0 for e in edges) or all(e <= 0 for e in edges))


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.integers(-8, 40), st.integers(-8, 40)), min_size=3, max_size=3),
    st.sampled_from([2, 3, 4]),
)
def test_coverage_is_exact(corners, divisor):
    screen = torch.tensor([[x / divisor, y / divisor, 1.0] for x, y in corners])
    (ax, ay), (bx, by), (cx, cy) = ((Fraction(float(p[0])), Fraction(float(p[1]))) for p in screen)
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    seen = rasterize(screen, torch.tensor([[0, 1, 2]]), 10, 10).face == 0
    for i in range(10):
        for j in range(10):
            inside = area != 0 and covers_exactly(screen, Fraction(2 * j + 1, 2), Fraction(2 * i + 1, 2))
            assert bool(seen[i, j]) == inside


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 70), st.floats(0, 0.49), st.booleans(), st.floats(-30, -0.01), st.integers(0, 999))
def test_shared_edges_leave_no_crack(cells, jitter, snap, low, seed):
    screen, faces = sheet(cells, low, 32 + 1.3 - low, jitter=jitter, snap=snap and cells < 20, seed=seed)
    assert (rasterize(screen, faces, 32, 32).face >= 0).all()


def test_an_edge_that_rounding_cannot_place_leaves_no_crack():
    """The edge passes pixel centres closer than float64 tells; equal evaluation in both faces keeps it shut."""
    random = torch.Generator().manual_seed(0)
    for _ in range(30):
        start = torch.rand(2, generator=random) * 1e-14
        points = torch.cat([start[None], torch.tensor([[64.5, 64.5], [-3.0, 70], [70, -3.0]])])
        screen = torch.cat([points, torch.ones(4, 1)], dim=1)
        for faces in ([[0, 1, 2], [1, 0, 3]], [[1, 0, 2], [0, 1, 3]]):
            assert (rasterize(screen, torch.tensor(faces), 64, 64).face.diagonal() >= 0).all()


def test_tiny_triangles_leave_no_crack():
    screen, faces = sheet(400, -0.37, 20.61, jitter=0.45)  # 400 triangles per pixel
    assert (rasterize(screen, faces, 20, 20).face >= 0).all()


def test_a_closed_mesh_has_no_holes():
    """A ball of radius 1 at distance 3 whose circle has the radius f / sqrt(8)."""
    y, x = torch.meshgrid(torch.arange(80) - 39.5, torch.arange(80) - 39.5, indexing="ij")
    radius, apart = 80 / math.sqrt(8), (x * x + y * y).sqrt()
    for level in (2, 3, 5):
        ball, faces = (torch.from_numpy(part) for part in sphere(level))
        depth = 3 - ball[:, 2:]
        covered = rasterize(torch.cat([40 + 80 * ball[:, :2] / depth, depth], 1), faces, 80, 80).face >= 0
        assert covered[apart < radius * math.cos(1.2 / 2**level) - 0.1].all()
        assert not covered[apart > radius + 0.1].any()


def test_inverse_depth_is_perspective_correct():
    """The plane z = 2 + 0.5 X with X = x z / f, so 1/z = (1 - 0.5 x / f) / 2."""
    f, corners = 50.0, torch.tensor([[-30.0, -25.0], [35.0, -20.0], [5.0, 31.0]])
    inverse = (1 - 0.5 * corners[:, 0] / f) / 2
    screen = torch.cat([corners + 32, 1 / inverse[:, None]], dim=1)
    seen = rasterize(screen, torch.tensor([[0, 1, 2]]), 64, 64)
    x = torch.arange(64) + 0.5 - 32
    expected = ((1 - 0.5 * x / f) / 2).expand(64, 64)
    covered = seen.face == 0
    assert int(covered.sum()) > 1000
    torch.testing.assert_close(seen.inverse_depth[covered], expected[covered], rtol=1e-6, atol=0)
    assert not seen.inverse_depth[~covered].any()


def test_the_nearest_face_wins_in_any_order(backend):
    count = backend.size(500, 15)
    screen, faces = backend.move(*soup(count, 48, 48, size=25.0))
    seen = rasterize(screen, faces, 48, 48)
    order = torch.randperm(count, generator=torch.Generator().manual_seed(1)).to(backend.device)
    shuffled = rasterize(screen, faces[order], 48, 48)
    assert torch.equal(shuffled.inverse_depth, seen.inverse_depth)
    assert torch.equal(torch.where(shuffled.face < 0, -1, order[shuffled.face.long()]), seen.face.long())


@pytest.mark.parametrize("height", [11, 24])  # on either side of what the GPU's backend calls a large face
def test_ties_go_to_the_lower_face(backend, height):
    screen = torch.tensor([[1.0, 1.0, 2.0], [20.0, 1.0, 2.0], [1.0, 20.0, 2.0]])
    seen = rasterize(*backend.move(screen, torch.tensor([[2, 1, 0]]).repeat(5, 1)), height, 24)
    assert set(seen.face.unique().tolist()) == {-1, 0}


@pytest.mark.parametrize(
    ("column", "bad"),
    [(2, 0.0), (2, -1.0), (2, math.nan), (2, math.inf), (0, math.nan), (1, math.inf), (0, -math.inf)],
)
def test_faces_behind_the_camera_or_not_finite_are_skipped(backend, column, bad):
    screen = torch.tensor([[1.0, 1.0, 1.0], [20.0, 1.0, 1.0], [1.0, 20.0, 1.0]]).repeat(2, 1)
    screen[3:, 2] = 5.0  # the whole face lies behind the bad one
    screen[1, column] = bad
    seen = rasterize(*backend.move(screen, torch.tensor([[0, 1, 2], [3, 4, 5]])), 24, 24)
    assert set(seen.face.unique().tolist()) == {-1, 1}


def test_faces_without_area_are_skipped(backend):
    screen = torch.tensor([[1.5, 1.5, 1.0], [9.5, 9.5, 1.0], [5.5, 5.5, 1.0]])
    seen = rasterize(*backend.move(screen, torch.tensor([[0, 1, 2], [0, 0, 1], [2, 2, 2]])), 12, 12)
    assert (seen.face == -1).all()


def test_huge_faces_are_cut_to_the_image(backend):
    screen = torch.tensor([[-1e9, -1e9, 1.0], [1e9, -1e9, 1.0], [0.0, 1e9, 1.0]])
    assert (rasterize(*backend.move(screen, torch.tensor([[0, 1, 2]])), 7, 300).face == 0).all()


def test_same_bits_on_one_thread():
    screen, faces = soup(3000, 120, 70)
    assert_same_bits(lambda: vars(rasterize(screen, faces, 120, 70)).values())


def test_wrong_input_is_refused():
    screen, faces = soup(2, 8, 8)
    with pytest.raises(IndexError, match="faces holds values"):
        rasterize(screen, faces + 1, 8, 8)
    with pytest.raises(ValueError, match="screen must have shape"):
        rasterize(screen[:, :2], faces, 8, 8)
    with pytest.raises(ValueError, match="at least one pixel"):
        rasterize(screen, faces, 0, 8)

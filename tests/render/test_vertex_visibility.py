"""What vertices see of their own mesh: in closed form, and in the colour of what stands before them."""

import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.render.vertex_visibility import point_visibility, vertex_visibility
from lightprobe.render.visibility import ambient_occlusion
from tests.shapes import ball_over_floor, sphere


def grey(faces: torch.Tensor) -> torch.Tensor:
    return torch.full(faces.shape, 0.5)


@pytest.mark.slow
def test_a_sphere_is_open_everywhere():
    vertices, faces = (torch.from_numpy(part) for part in sphere(3))
    assert float(ambient_occlusion(vertex_visibility(vertices, faces, grey(faces)), vertices).min()) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "height"), [(0.3, 0.6), (0.2, 0.5), (0.4, 0.45)])
def test_under_a_ball_a_cone_is_blocked(radius, height):
    vertices, faces, middle = ball_over_floor(radius, height)
    normals = torch.tensor([0.0, 0, 1]).expand(len(vertices), 3)
    opened = float(ambient_occlusion(vertex_visibility(vertices, faces, grey(faces)), normals)[middle])
    assert opened == pytest.approx(
        1 - (radius / height) ** 2, abs=0.05
    )  # one of 384 directions weighs up to .02


@pytest.mark.slow
def test_the_floor_under_a_red_ball_sees_red():
    vertices, faces, middle = ball_over_floor(0.3, 0.4)
    red, blue = torch.tensor([0.8, 0.1, 0.1]), torch.tensor([0.1, 0.1, 0.8])
    ball = (faces >= 41 * 41).all(1, keepdim=True)
    seen = vertex_visibility(vertices, faces, torch.where(ball, red, blue))
    torch.testing.assert_close(seen.occluder_color[middle], red, atol=1e-3, rtol=0)
    lowest = 41 * 41 + int(vertices[41 * 41 :, 2].argmin())
    torch.testing.assert_close(seen.occluder_color[lowest], blue, atol=0.02, rtol=0)
    torch.testing.assert_close(seen.brightened(0.5).occluder_color, 0.5 * seen.occluder_color)


def two_balls() -> tuple[torch.Tensor, torch.Tensor]:
    """Return a ball and a smaller one half within it."""
    vertices, faces = (torch.from_numpy(part) for part in sphere(2))
    beside = 0.4 * vertices + torch.tensor([0.5, 0.1, 0.3])
    return torch.cat([0.6 * vertices, beside]), torch.cat([faces, faces + len(vertices)])


@pytest.mark.slow
def test_a_solid_is_blocked_by_the_faces_that_look_at_the_light_alone():
    vertices, faces = two_balls()
    every = vertex_visibility(
        vertices, faces[:-1], grey(faces[:-1])
    )  # with a hole, so that no face is left out
    table = vertex_visibility(vertices, faces, grey(faces)).unoccluded
    assert (table == 0).all(1).sum() > 8  # within the other ball
    assert (table != every.unoccluded).float().mean() < 1e-3


@pytest.mark.slow
def test_the_colour_seen_is_that_of_the_other_ball():
    vertices, faces = two_balls()
    count = len(vertices) // 2
    red, blue = torch.tensor([0.8, 0.1, 0.1]), torch.tensor([0.1, 0.1, 0.8])
    seen = vertex_visibility(vertices, faces, torch.where((faces < count)[:, :1], red, blue))
    nearest = int((vertices[:count] - vertices[count:].mean(0)).norm(dim=1).argmin())
    torch.testing.assert_close(seen.occluder_color[nearest], blue, atol=0.05, rtol=0)


DIRECTIONS, ANGLES = cubemap.directions(8).reshape(-1, 3), cubemap.solid_angles(8).reshape(-1)
COLORS = torch.tensor([[0.9, 0.2, 0.1], [0.1, 0.3, 0.8]])
LEVEL = 0.5  # of the sheet


def sheet() -> tuple[torch.Tensor, torch.Tensor]:
    """Return a sheet of two triangles over the origin, 1.4 by 1 in size and off its middle."""
    corners = [(-0.4, -0.3), (1.0, -0.3), (1.0, 0.7), (-0.4, 0.7)]
    return torch.tensor([(x, y, LEVEL) for x, y in corners]), torch.tensor(
        [[0, 1, 2], [0, 2, 3]], dtype=torch.int32
    )


def before(margin: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Return which directions from the origin (384,) hit the sheet made wider by a margin, and which
    triangle.
    """
    x, y = (LEVEL * DIRECTIONS[:, axis] / DIRECTIONS[:, 2].clamp(min=1e-6) for axis in (0, 1))
    hit = (
        (DIRECTIONS[:, 2] > 0)
        & (x > -0.4 - margin)
        & (x < 1.0 + margin)
        & (y > -0.3 - margin)
        & (y < 0.7 + margin)
    )
    return hit, ((y + 0.3) * 1.4 > (x + 0.4) * 1.0).long()


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.6, 0.8), (0.8, 0.0, -0.6)])
def test_a_point_sees_all_above_its_horizon_but_what_the_sheet_hides(normal):
    """And a little below, as the horizon of a vertex is not that of the faces around it."""
    up = torch.tensor([normal])
    seen = point_visibility(*sheet(), COLORS, torch.zeros(1, 3), up)
    cosine = DIRECTIONS @ up[0]
    (surely, triangle), (maybe, _) = before(-0.05), before(0.05)
    table = seen.unoccluded[0]
    assert surely.sum() > 30
    assert (table[surely | (cosine <= -0.2)] == 0).all()
    assert (table[~maybe & (cosine > -0.2)] == 255).all()
    assert ((cosine > -0.2) & (cosine < 0) & ~maybe).any()
    assert ((cosine <= -0.2) & (cosine > -0.28)).any()
    hidden = (1 - table / 255.0) * cosine.clamp(min=0) * ANGLES * maybe
    if float(hidden.sum()) > 0.1:
        mean = (hidden[:, None] * COLORS[triangle]).sum(0) / hidden.sum()
        torch.testing.assert_close(seen.occluder_color[0], mean, rtol=0, atol=0.03)


def test_directions_that_nobody_asks_for_are_open_down_to_the_horizon():
    up, (surely, _) = torch.tensor([[0.0, 0.6, 0.8]]), before(-0.05)
    vertices, faces = sheet()
    asked = torch.zeros(384, dtype=torch.bool)
    seen = point_visibility(vertices, faces, COLORS, torch.zeros(1, 3), up, asked=asked)
    expected = torch.where(DIRECTIONS @ up[0] > -0.2, 255, 0)
    assert torch.equal(seen.unoccluded[0].long(), expected)
    torch.testing.assert_close(
        seen.occluder_color[0], torch.tensor([0.5, 0.25, 0.45])
    )  # none: the mean of all
    asked[surely.nonzero()[:5, 0]] = True
    seen = point_visibility(vertices, faces, COLORS, torch.zeros(1, 3), up, asked=asked)
    assert torch.equal(seen.unoccluded[0].long(), torch.where(asked, 0, expected))

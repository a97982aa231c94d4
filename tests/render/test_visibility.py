"""The object's own shadows: visibility in closed form, and what shading makes of it."""

import dataclasses

import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.prefilter import cached
from lightprobe.render import visibility as module
from lightprobe.render.split_sum import furnace, shade
from lightprobe.render.visibility import (
    OpenLight,
    PointVisibility,
    VertexVisibility,
    ambient_occlusion,
    point_visibility,
    vertex_visibility,
)
from tests.gbuffers import R, sphere_gbuffer
from tests.shapes import ball_over_floor, sphere


def grey(faces: torch.Tensor) -> torch.Tensor:
    return torch.full(faces.shape, 0.5)


def shaded_gbuffer(blockers=(0.6, 0.3, 0.8), **material):
    """A sphere's pixels, each open in a half-random way, among surfaces of one colour."""
    gbuffer = sphere_gbuffer(400, **material)
    random = torch.Generator().manual_seed(1)
    table = torch.randint(0, 256, (30, 384), generator=random, dtype=torch.uint8)
    index = torch.randint(0, 30, (400, 3), generator=random)
    weight = torch.rand(400, 3, generator=random)
    seen = VertexVisibility(table, torch.tensor(blockers).expand(30, 3).contiguous())
    points = PointVisibility(seen, index, weight / weight.sum(1, keepdim=True))
    return dataclasses.replace(gbuffer, visibility=points)


@pytest.mark.slow
def test_the_shadow_falls_away_from_the_light():
    vertices, faces, _ = ball_over_floor(0.2, 0.4)
    point = torch.tensor([[0.4, 0.0, 0.0]])
    nearest = int((vertices[: 41 * 41] - point).norm(dim=1).argmin())
    seen = vertex_visibility(vertices, faces, grey(faces))
    visibility = PointVisibility(seen, torch.full((2, 3), nearest), torch.tensor([[1.0, 0, 0]] * 2))
    to_ball, away = visibility.towards(torch.tensor([[-0.7, 0.0, 0.7], [0.7, 0.0, 0.7]]))
    assert float(to_ball) < 0.1
    assert float(away) > 0.9


@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_what_blocks_lends_its_colour(metallic):
    """The object's own colour has no part in it: gold beside black reflects black."""
    material = {"roughness": 0.3, "metallic": metallic, "base": (0.9, 0.7, 0.2)}
    colors = (0.0,) * 3, (1.0,) * 3, (1.0, 0.25, 0.0)
    dark, light, red = (furnace(shaded_gbuffer(color, **material)) for color in colors)
    assert bool((light > dark + 0.01).all())
    expected = dark + torch.tensor([1.0, 0.25, 0.0]) * (light - dark)
    torch.testing.assert_close(red, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_furnace(metallic):
    gbuffer, operator = shaded_gbuffer(roughness=0.4, metallic=metallic), cached(R)
    white = shade(gbuffer, operator, torch.ones(operator.total, 3))
    torch.testing.assert_close(furnace(gbuffer), white, rtol=1e-4, atol=1e-5)
    unshadowed = furnace(dataclasses.replace(gbuffer, visibility=None))
    assert bool((white <= unshadowed + 1e-5).all())
    white = (1.0, 1.0, 1.0)
    lossless = shaded_gbuffer(roughness=0.4, metallic=metallic, base=white, blockers=white)
    unshadowed = furnace(dataclasses.replace(lossless, visibility=None))
    torch.testing.assert_close(furnace(lossless), unshadowed, rtol=1e-4, atol=1e-5)


DIRECTIONS, ANGLES = cubemap.directions(8).reshape(-1, 3), cubemap.solid_angles(8).reshape(-1)


def two_vertices() -> PointVisibility:
    """Return a point a quarter of the way from a vertex that is open by 1/5 to one that sees the half x > 0."""
    halves = torch.where(DIRECTIONS[:, 0] > 0, 255, 0)
    table = torch.stack([torch.full((384,), 51), halves]).to(torch.uint8)
    colors = torch.tensor([[0.8, 0.4, 0.2], [0.4, 0.6, 1.0]])
    seen = VertexVisibility(table, colors)
    return PointVisibility(seen, torch.tensor([[1, 0]]), torch.tensor([[0.25, 0.75]]))


def test_between_vertices_openness_and_colour_are_weighed():
    point = two_vertices()
    for way, openness in ((torch.tensor([[0.9, 0.1, 0.3]]), 0.4), (torch.tensor([[-0.9, 0.1, 0.3]]), 0.15)):
        assert float(point.towards(way)) == pytest.approx(openness, abs=1e-6)
        normal = way / way.norm()
        lune = (1 + float(normal[0, 0])) / 2  # the half's part of the hemisphere, weighted by the cosine
        assert float(point.share(normal)) == pytest.approx(0.15 + 0.25 * lune, abs=0.005)
    torch.testing.assert_close(point.occluder_color(), torch.tensor([[0.7, 0.45, 0.4]]))
    torch.testing.assert_close(point.brightened(1.5).occluder_color(), torch.tensor([[0.9, 0.675, 0.475]]))


def test_light_is_averaged_over_the_cosine_and_over_what_is_open():
    point, normal = two_vertices(), torch.tensor([[0.6, 0.0, 0.8]])
    light = torch.rand(384, 3, generator=torch.Generator().manual_seed(2))
    opened = 0.75 * 0.2 + 0.25 * (DIRECTIONS[:, :1] > 0)
    cosine = (DIRECTIONS @ normal[0]).clamp(min=0)[:, None] * ANGLES[:, None]
    diffuse = (cosine * opened * light).sum(0) / cosine.sum()
    ambient = (ANGLES[:, None] * opened * light).sum(0) / (ANGLES[:, None] * opened).sum()
    share = (cosine * opened).sum() / cosine.sum()
    expected = torch.cat([diffuse, ambient, share[None]])
    torch.testing.assert_close(point.light(light, normal)[0], expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("at_once", [400, 64])
def test_open_light_is_the_light_past_the_object_and_has_its_transpose(at_once, monkeypatch):
    monkeypatch.setattr(module, "_AT_ONCE", at_once)
    gbuffer, rows = shaded_gbuffer(), torch.tensor([7, 399, 0])
    blocks, arriving = torch.rand(384, 3), torch.rand(2, 400, 3)
    linear = OpenLight(gbuffer.visibility, gbuffer.normal)
    expected = gbuffer.visibility.light(blocks, gbuffer.normal)[:, :6].unflatten(1, (2, 3)).transpose(0, 1)
    torch.testing.assert_close(linear.apply(blocks), expected, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(linear.select(rows).apply(blocks), expected[:, rows], rtol=1e-4, atol=1e-5)
    back = linear.adjoint(arriving)
    torch.testing.assert_close((back * blocks).sum(), (expected * arriving).sum(), rtol=1e-4, atol=1e-3)


def test_occlusion_of_a_vertex_is_the_closed_share_of_its_own_hemisphere():
    """Each vertex asks its own row of the table."""
    halves = [torch.where(DIRECTIONS[:, axis] * sign > 0, 255, 0) for axis, sign in ((0, 1), (1, 1), (2, -1))]
    seen = VertexVisibility(torch.stack(halves).to(torch.uint8), torch.zeros(3, 3))
    opened = ambient_occlusion(seen, torch.tensor([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    assert opened.tolist() == pytest.approx([0.5, 1.0, 0.0], abs=1e-5)


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
    assert opened == pytest.approx(1 - (radius / height) ** 2, abs=0.05)  # a direction weighs up to .02


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


COLORS = torch.tensor([[0.9, 0.2, 0.1], [0.1, 0.3, 0.8]])
LEVEL = 0.5  # of the sheet


def sheet() -> tuple[torch.Tensor, torch.Tensor]:
    """Return a sheet of two triangles over the origin, 1.4 by 1 in size and off its middle."""
    corners = [(-0.4, -0.3), (1.0, -0.3), (1.0, 0.7), (-0.4, 0.7)]
    return torch.tensor([(x, y, LEVEL) for x, y in corners]), torch.tensor([[0, 1, 2], [0, 2, 3]]).int()


def before(margin: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Return which directions (384,) from the origin hit the sheet widened by a margin, and which triangle."""
    x, y = (LEVEL * DIRECTIONS[:, axis] / DIRECTIONS[:, 2].clamp(min=1e-6) for axis in (0, 1))
    across = (x > -0.4 - margin) & (x < 1.0 + margin)
    hit = (DIRECTIONS[:, 2] > 0) & across & (y > -0.3 - margin) & (y < 0.7 + margin)
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
    mean = torch.tensor([0.5, 0.25, 0.45])  # as nothing is blocked
    torch.testing.assert_close(seen.occluder_color[0], mean)
    asked[surely.nonzero()[:5, 0]] = True
    seen = point_visibility(vertices, faces, COLORS, torch.zeros(1, 3), up, asked=asked)
    assert torch.equal(seen.unoccluded[0].long(), torch.where(asked, 0, expected))

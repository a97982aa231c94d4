"""The object's own shadows: visibility in closed form, and what shading and the transport make of it."""

import dataclasses

import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.prefilter import cached
from lightprobe.render import transport
from lightprobe.render.split_sum import Shading, furnace, shade
from lightprobe.render.taps import GatheredTaps, SparseTaps
from lightprobe.render.transport import Transport
from lightprobe.render.vertex_visibility import vertex_visibility
from lightprobe.render.visibility import PointVisibility, VertexVisibility, ambient_occlusion
from tests.gbuffers import R, sky, sphere_gbuffer
from tests.shapes import ball_over_floor


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
    return dataclasses.replace(
        gbuffer, visibility=PointVisibility(seen, index, weight / weight.sum(1, keepdim=True))
    )


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


@pytest.mark.parametrize("taps", [SparseTaps, GatheredTaps])  # a CPU's and a GPU's
def test_transport_is_shading_and_its_transpose(taps, monkeypatch):
    monkeypatch.setattr(transport, "look_up", lambda device: taps)
    gbuffer, operator = shaded_gbuffer(roughness=0.35, metallic=0.3), cached(R)
    light, radiance = sky(R), torch.randn(400, 3)
    linear = Transport(gbuffer, operator)
    expected = shade(gbuffer, operator, operator.apply(light))
    torch.testing.assert_close(linear.apply(light), expected, rtol=1e-4, atol=1e-5)
    kept = Shading.of(gbuffer, operator).apply(operator.apply(light))
    torch.testing.assert_close(kept, expected, rtol=1e-5, atol=1e-6)
    product, transposed = (expected * radiance).sum(), (linear.adjoint(radiance) * light).sum()
    torch.testing.assert_close(product, transposed, rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_what_blocks_lends_its_colour(metallic):
    """The object's own colour has no part in it: gold beside black reflects black."""
    material = {"roughness": 0.3, "metallic": metallic, "base": (0.9, 0.7, 0.2)}
    dark, light, red = (
        furnace(shaded_gbuffer(c, **material)) for c in ((0.0,) * 3, (1.0,) * 3, (1.0, 0.25, 0.0))
    )
    assert bool((light > dark + 0.01).all())
    torch.testing.assert_close(
        red, dark + torch.tensor([1.0, 0.25, 0.0]) * (light - dark), rtol=1e-4, atol=1e-5
    )


@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_furnace(metallic):
    gbuffer, operator = shaded_gbuffer(roughness=0.4, metallic=metallic), cached(R)
    white = shade(gbuffer, operator, torch.ones(operator.total, 3))
    torch.testing.assert_close(furnace(gbuffer), white, rtol=1e-4, atol=1e-5)
    unshadowed = furnace(dataclasses.replace(gbuffer, visibility=None))
    assert bool((white <= unshadowed + 1e-5).all())
    lossless = shaded_gbuffer(
        roughness=0.4, metallic=metallic, base=(1.0, 1.0, 1.0), blockers=(1.0, 1.0, 1.0)
    )
    unshadowed = furnace(dataclasses.replace(lossless, visibility=None))
    torch.testing.assert_close(furnace(lossless), unshadowed, rtol=1e-4, atol=1e-5)


DIRECTIONS, ANGLES = cubemap.directions(8).reshape(-1, 3), cubemap.solid_angles(8).reshape(-1)


def two_vertices() -> PointVisibility:
    """Return a point a quarter of the way from a vertex that is open by 1/5 to one that sees the half x > 0."""
    halves = torch.where(DIRECTIONS[:, 0] > 0, 255, 0)
    table = torch.stack([torch.full((384,), 51), halves]).to(torch.uint8)
    colors = torch.tensor([[0.8, 0.4, 0.2], [0.4, 0.6, 1.0]])
    return PointVisibility(
        VertexVisibility(table, colors), torch.tensor([[1, 0]]), torch.tensor([[0.25, 0.75]])
    )


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


def test_occlusion_of_a_vertex_is_the_closed_share_of_its_own_hemisphere():
    """Each vertex asks its own row of the table."""
    halves = [torch.where(DIRECTIONS[:, axis] * sign > 0, 255, 0) for axis, sign in ((0, 1), (1, 1), (2, -1))]
    seen = VertexVisibility(torch.stack(halves).to(torch.uint8), torch.zeros(3, 3))
    opened = ambient_occlusion(seen, torch.tensor([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    assert opened.tolist() == pytest.approx([0.5, 1.0, 0.0], abs=1e-5)

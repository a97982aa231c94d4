from dataclasses import replace

import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.prefilter import cached
from lightprobe.render.brdf import base_reflectance, environment_brdf
from lightprobe.render.split_sum import (
    Shading,
    furnace,
    occlude,
    reflectance,
    shade,
    specular_taps,
    towards_seen,
)
from lightprobe.render.visibility import PointVisibility, VertexVisibility
from tests.gbuffers import R, any_gbuffer, brute_force, sky, sphere_gbuffer


def test_white_furnace():
    """White metal under a white light reflects at most what arrives, and nearly all of it when smooth."""
    operator = cached(R)
    white = operator.apply(torch.ones(6, R, R, 3))
    smooth = shade(sphere_gbuffer(roughness=0.1, metallic=1.0, base=(1, 1, 1)), operator, white)
    rough = shade(sphere_gbuffer(roughness=0.9, metallic=1.0, base=(1, 1, 1)), operator, white)
    assert smooth.max() < 1.01
    assert smooth.mean() > 0.97
    assert rough.max() < 1.0
    dielectric = shade(sphere_gbuffer(roughness=0.5, base=(1, 1, 1)), operator, white)
    assert dielectric.mean() == pytest.approx(1.0, abs=0.02)  # Fresnel's term exceeds 1 at the rim alone
    assert dielectric.max() < 1.12


@pytest.mark.parametrize("roughness", [0.2, 0.3, 0.35, 0.5, 0.65, 0.8, 1.0])
@pytest.mark.parametrize(("metallic", "bound"), [(0.0, 0.015), (1.0, 0.05)])
def test_split_sum_stays_near_the_integral(metallic, bound, roughness):
    gbuffer = sphere_gbuffer(150, roughness=roughness, metallic=metallic)
    fine = sky(64)
    light = torch.nn.functional.avg_pool2d(fine.permute(0, 3, 1, 2), 2).permute(0, 2, 3, 1).contiguous()
    operator = cached(32)
    ours = shade(gbuffer, operator, operator.apply(light)).double()
    truth = brute_force(gbuffer, fine)
    error = float((ours - truth).square().mean().sqrt() / truth.square().mean().sqrt())
    assert error < bound


def test_a_constant_light_is_reflected_exactly():
    gbuffer, operator = any_gbuffer(500), cached(R)
    cosine = (gbuffer.normal * gbuffer.view).sum(-1)
    f0 = base_reflectance(gbuffer.base_color, gbuffer.metallic)
    a, b, c = environment_brdf(cosine, gbuffer.roughness)
    passed = (1 - gbuffer.metallic) * (1 - c)
    expected = f0 * a[:, None] + b[:, None] + gbuffer.base_color * (1 - f0) * passed[:, None]
    found = shade(gbuffer, operator, torch.full((operator.total, 3), 0.7))
    assert torch.allclose(found, 0.7 * expected, atol=1e-5)


def test_no_light_counts_negative():
    gbuffer, operator = any_gbuffer(5000), cached(R)
    r = reflectance(gbuffer)
    weights = specular_taps(r, gbuffer, operator)[1], operator.diffuse_taps(gbuffer.normal)[1]
    for values in (r.specular, r.share, r.diffuse, *weights):
        assert values.min() >= 0


@pytest.mark.slow
def test_gradients_of_the_surface():
    """In all attributes of the surface, against finite differences, off the nodes of the tables."""
    gbuffer, operator = any_gbuffer(12, torch.float64), cached(R)
    levels = torch.rand(operator.total, 3, generator=torch.Generator().manual_seed(6), dtype=torch.float64)
    names = ("normal", "view", "base_color", "roughness", "metallic")

    def shaded(*values):
        return shade(replace(gbuffer, **dict(zip(names, values, strict=True))), operator, levels)

    variables = [getattr(gbuffer, name).clone().requires_grad_() for name in names]
    assert torch.autograd.gradcheck(shaded, variables)


def test_shading_kept_for_many_lights_is_shading():
    gbuffer, operator = any_gbuffer(400), cached(R)
    shading = Shading.of(gbuffer, operator)
    for light in (sky(R), sky(R).flip(1)):
        levels = operator.apply(light)
        expected = shade(gbuffer, operator, levels)
        torch.testing.assert_close(shading.apply(levels), expected, rtol=1e-5, atol=1e-6)


def test_the_mirror_direction_has_the_view_s_angle_on_the_other_side():
    gbuffer = sphere_gbuffer(2)
    normal = torch.tensor([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])
    view = torch.tensor([[0.0, 0.6, 0.8], [0.8, -0.6, 0.0]])  # the second sees its pixel from behind
    found = reflectance(replace(gbuffer, normal=normal, view=view)).mirror
    expected = torch.tensor([[2 * 0.64 * 0.6, -0.6, 2 * 0.64 * 0.8 - 0.8], [-0.8, -0.6, 0.0]])
    torch.testing.assert_close(found, expected)


def half_open(gbuffer, opened: int, color=(0.9, 0.5, 0.1)):
    """Return the pixels, each open by the same share of 255 in all directions, between surfaces of one colour."""
    count = len(gbuffer.pixel)
    seen = VertexVisibility(torch.full((1, 384), opened, dtype=torch.uint8), torch.tensor([color]))
    points = PointVisibility(seen, torch.zeros(count, 1).long(), torch.ones(count, 1))
    return replace(gbuffer, visibility=points)


def test_a_lobe_is_as_open_as_its_axis_when_sharp_and_as_its_hemisphere_when_matte():
    gbuffer = half_open(replace(any_gbuffer(3), roughness=torch.tensor([0.0, 0.5, 1.0])), 51)
    r, opened = reflectance(gbuffer), torch.tensor([0.7, 0.7, 0.7])
    lobe, bounce = occlude(gbuffer, r, opened)
    torch.testing.assert_close(lobe[:, 0], torch.tensor([0.2, 0.2 + 0.25 * 0.5, 0.7]))
    blocked = 0.3 * r.diffuse + r.specular * r.share * (1 - torch.tensor([[0.2], [0.325], [0.7]]))
    torch.testing.assert_close(bounce, blocked * torch.tensor([0.9, 0.5, 0.1]))
    with pytest.raises(ValueError, match="no visibility"):
        occlude(replace(gbuffer, visibility=None), r, opened)


def test_a_constant_light_reaches_an_open_share_directly_and_the_rest_by_a_bounce():
    plain, operator, color = any_gbuffer(300), cached(R), torch.tensor([0.9, 0.5, 0.1])
    gbuffer, levels = half_open(plain, 102), torch.full((operator.total, 3), 3.0)
    expected = 3.0 * furnace(plain) * (0.4 + 0.6 * color)
    torch.testing.assert_close(shade(gbuffer, operator, levels), expected, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(Shading.of(gbuffer, operator).apply(levels), expected, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(3.0 * furnace(gbuffer), expected, rtol=1e-4, atol=1e-4)


def test_a_matte_white_surface_shows_the_mean_light_around_its_normal():
    """In absolute radiance, by channel: a dielectric keeps base (1 - F0) (1 - C) of the light."""
    normal = torch.nn.functional.normalize(torch.tensor([[0.3, -0.5, 0.8], [-0.7, 0.2, 0.1]]), dim=1)
    white, black = (
        replace(sphere_gbuffer(2, roughness=1.0, base=(base, base / 2, base / 4)), normal=normal, view=normal)
        for base in (0.8, 0.0)
    )
    operator, light = cached(R), sky(R)
    levels = operator.apply(light)
    found = shade(white, operator, levels) - shade(black, operator, levels)
    d, angle = cubemap.directions(R).reshape(-1, 3), cubemap.solid_angles(R).reshape(-1)
    weight = (normal @ d.T).clamp(min=0) * angle / torch.pi
    reflected = float(environment_brdf(torch.ones(1), torch.ones(1))[2])
    kept = torch.tensor([0.8, 0.4, 0.2]) * 0.96 * (1 - reflected)
    torch.testing.assert_close(found, kept * (weight @ light.reshape(-1, 3)), rtol=0.01, atol=1e-3)


TABLE = torch.tensor([0.0, 0.0, 1.0, -1.3])  # under a ball of radius 1


def table_light(direction):
    """Return what lies towards directions (..., 3) from the ball's centre: the table with a smooth print, the sky."""
    point = direction * (TABLE[3] / direction[..., 2:].clamp(max=-1e-3))
    printed = 0.5 + 0.4 * torch.sin(1.5 * point[..., :1]) * torch.sin(1.5 * point[..., 1:2])
    return torch.where(direction[..., 2:] < 0, printed, 0.3).expand(*direction.shape[:-1], 3)


def test_a_mirror_shows_the_table_where_its_rays_meet_it():
    """Of points half a radius above it: what is towards the ray's end from the centre, not what lies along the ray."""
    resolution = 64
    ball, operator = sphere_gbuffer(4000, roughness=0.1, metallic=1.0, base=(1, 1, 1)), cached(resolution)
    levels = operator.apply(table_light(cubemap.directions(resolution)).contiguous())
    mirror = reflectance(ball).mirror
    down = (mirror[:, 2] < -0.5) & (ball.position[:, 2] < 0)
    along = (TABLE[3] - ball.position[:, 2]) / mirror[:, 2].clamp(max=-0.1)
    end = ball.position + along[:, None] * mirror
    true = table_light(end)[down] * reflectance(ball).specular[down]
    near = shade(replace(ball, support=TABLE), operator, levels)[down]
    far = shade(ball, operator, levels)[down]
    assert int(down.sum()) > 100
    assert float((near - true).abs().mean()) < 0.03
    assert float((far - true).abs().mean()) > 0.15
    torch.testing.assert_close(
        Shading.of(replace(ball, support=TABLE), operator).apply(levels)[down], near, atol=1e-5, rtol=1e-4
    )


def test_a_table_changes_nothing_above_the_horizon():
    ball = sphere_gbuffer(500, roughness=0.3)
    direction = torch.nn.functional.normalize(reflectance(ball).mirror, dim=1)
    found, up = towards_seen(replace(ball, support=TABLE), direction), direction[:, 2] >= 0
    assert torch.equal(found[up], direction[up])
    assert not torch.allclose(found[~up], direction[~up])

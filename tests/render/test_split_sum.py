from dataclasses import replace

import pytest
import torch

from lightprobe.light.prefilter import cached
from lightprobe.render.brdf import base_reflectance, diffuse_fresnel, environment_brdf
from lightprobe.render.split_sum import Shading, reflectance, shade, specular_taps
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
    assert dielectric.mean() == pytest.approx(1.0, abs=0.02)  # beyond 1 only at the rim, where Fresnel's term rises
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
    a, b = environment_brdf(cosine, gbuffer.roughness)
    passed = (1 - gbuffer.metallic) * (1 - diffuse_fresnel(cosine))
    expected = f0 * a[:, None] + b[:, None] + gbuffer.base_color * (1 - f0) * passed[:, None]
    assert torch.allclose(shade(gbuffer, operator, torch.full((operator.total, 3), 0.7)), 0.7 * expected, atol=1e-5)


def test_no_light_counts_negative():
    gbuffer, operator = any_gbuffer(5000), cached(R)
    r = reflectance(gbuffer)
    weights = specular_taps(r, gbuffer.normal, operator)[1], operator.diffuse_taps(gbuffer.normal)[1]
    for values in (r.specular, r.share, r.diffuse, *weights):
        assert values.min() >= 0


def test_gradients_of_the_surface():
    """In all attributes of the surface, against finite differences; points on the nodes of a table would have none."""
    gbuffer, operator = any_gbuffer(12, torch.float64), cached(R)
    levels = torch.rand(operator.total, 3, generator=torch.Generator().manual_seed(6), dtype=torch.float64)
    names = ("normal", "view", "base_color", "roughness", "metallic")

    def shaded(*values):
        return shade(replace(gbuffer, **dict(zip(names, values, strict=True))), operator, levels)

    assert torch.autograd.gradcheck(shaded, [getattr(gbuffer, name).clone().requires_grad_() for name in names])


def test_shading_kept_for_many_lights_is_shading():
    gbuffer, operator = any_gbuffer(400), cached(R)
    shading = Shading.of(gbuffer, operator)
    for light in (sky(R), sky(R).flip(1)):
        levels = operator.apply(light)
        torch.testing.assert_close(shading.apply(levels), shade(gbuffer, operator, levels), rtol=1e-5, atol=1e-6)

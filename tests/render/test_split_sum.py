import math
from dataclasses import replace

import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.prefilter import cached
from lightprobe.render import transport
from lightprobe.render.brdf import base_reflectance, diffuse_fresnel, environment_brdf
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import Shading, reflectance, shade, specular_taps
from lightprobe.render.transport import Transport, solve_light
from tests.gbuffers import R, any_gbuffer, sky, sphere_gbuffer


def brute_force(gbuffer: GBuffer, light: torch.Tensor) -> torch.Tensor:
    """The reflection integral of the exact BRDF by summation over a fine light (6, N, N, 3)."""
    resolution = light.shape[1]
    light_in = cubemap.directions(resolution).reshape(-1, 3).double()
    weight = cubemap.solid_angles(resolution).reshape(-1).double()
    radiance = light.reshape(-1, 3).double()
    out = []
    for i in range(len(gbuffer.pixel)):
        n, v, base = gbuffer.normal[i].double(), gbuffer.view[i].double(), gbuffer.base_color[i].double()
        m, alpha = float(gbuffer.metallic[i]), float(gbuffer.roughness[i]) ** 2
        nl, nv = (light_in @ n).clamp(min=0), float(n @ v)
        h = torch.nn.functional.normalize(light_in + v, dim=1)
        d = alpha**2 / (math.pi * ((h @ n) ** 2 * (alpha**2 - 1) + 1) ** 2)
        smith = nl * math.sqrt(alpha**2 + (1 - alpha**2) * nv**2) + nv * (alpha**2 + (1 - alpha**2) * nl**2).sqrt()
        f0 = 0.04 * (1 - m) + base * m
        f = f0 + (1 - f0) * ((1 - (h @ v).clamp(0, 1)) ** 5)[:, None]
        brdf = (1 - f) * base * (1 - m) / math.pi + f * (d * 0.5 / smith.clamp(min=1e-9))[:, None]
        out.append((brdf * (nl * weight)[:, None] * radiance).sum(0))
    return torch.stack(out)


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


def test_environment_brdf_matches_direct_integration():
    cos_view, roughness = torch.tensor([0.9, 0.5, 0.25]), torch.tensor([0.4, 0.6, 0.3])
    a, b = environment_brdf(cos_view, roughness)
    for i in range(3):
        for f0, expected in ((0.0, b[i]), (1.0, a[i] + b[i])):
            v = torch.tensor([math.sqrt(1 - float(cos_view[i]) ** 2), 0.0, float(cos_view[i])])
            g = sphere_gbuffer(1, roughness=float(roughness[i]), metallic=1.0, base=(f0,) * 3)
            g = GBuffer(**{**vars(g), "normal": torch.tensor([[0.0, 0, 1]]), "view": v[None]})
            assert float(brute_force(g, torch.ones(6, 96, 96, 3))[0, 0]) == pytest.approx(float(expected), abs=0.012)


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


@pytest.mark.parametrize("taps", [transport._SparseTaps, transport._GatheredTaps])  # a CPU's and a GPU's
def test_transport_is_the_renderer_and_its_adjoint(taps, monkeypatch):
    monkeypatch.setattr(transport, "_look_up", lambda device: taps)
    gbuffer, operator = sphere_gbuffer(200, metallic=0.4), cached(R)
    light = sky(R)
    linear = Transport(gbuffer, operator)
    rendered = shade(gbuffer, operator, operator.apply(light))
    assert torch.allclose(linear.apply(light), rendered, rtol=1e-4, atol=1e-5)
    other = torch.rand(200, 3, generator=torch.Generator().manual_seed(3))
    left = float((linear.apply(light) * other).double().sum())
    assert left == pytest.approx(float((light * linear.adjoint(other)).double().sum()), rel=1e-4)


def test_shading_kept_for_many_lights_is_shading():
    gbuffer, operator = any_gbuffer(400), cached(R)
    shading = Shading.of(gbuffer, operator)
    for light in (sky(R), sky(R).flip(1)):
        levels = operator.apply(light)
        torch.testing.assert_close(shading.apply(levels), shade(gbuffer, operator, levels), rtol=1e-5, atol=1e-6)


def test_solve_recovers_light_and_clipped_highlights():
    gbuffer, operator = sphere_gbuffer(3000, roughness=0.1, metallic=1.0, base=(0.9, 0.9, 0.9)), cached(R)
    truth = sky(R)
    linear = Transport(gbuffer, operator)
    image = linear.apply(truth)
    seen = image.clamp(max=10.0)
    prior = torch.full_like(truth, float(seen.mean()))
    solved = solve_light(linear, seen, torch.ones(3000), seen >= 10.0, prior, 1e-4, 60)
    again = linear.apply(solved)
    free = (image < 10.0).all(1)
    assert float((again - image)[free].square().mean().sqrt() / image[free].mean()) < 0.05
    assert (again[~free].amax(1) > 9.5).all()
    assert (solved >= 0).all()


def test_unseen_directions_go_to_the_prior():
    gbuffer, operator = sphere_gbuffer(2000, roughness=0.15, metallic=1.0), cached(R)
    facing = (gbuffer.normal[:, 0] > 0.9).nonzero()[:, 0]  # these mirror only what is before the object
    linear = Transport(gbuffer, operator, facing)
    count = len(facing)
    prior = torch.full((6, R, R, 3), 0.3)
    seen = linear.adjoint(torch.ones(count, 3)).mean(-1)
    clipped = torch.zeros(count, 3, dtype=torch.bool)
    solved = solve_light(linear, linear.apply(sky(R)), torch.ones(count), clipped, prior, 0.1, 20)
    dark = seen < 1e-3 * seen.max()
    assert dark.float().mean() > 0.2
    assert (solved[dark] - 0.3).abs().max() < 0.03
    assert torch.isfinite(solved).all()

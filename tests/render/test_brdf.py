"""The integrals of the reflectance model: against sums over directions, their bounds, and their gradients."""

import math

import numpy as np
import pytest
import torch

from lightprobe.core.checkpoint import load_tensors
from lightprobe.light import cubemap
from lightprobe.render.brdf import DIELECTRIC_F0, TABLE, base_reflectance, environment_brdf
from lightprobe.render.gbuffer import GBuffer
from make_brdf_table import integrals
from tests.gbuffers import brute_force, sphere_gbuffer


def test_environment_brdf_matches_direct_integration():
    cos_view, roughness = torch.tensor([0.9, 0.5, 0.25]), torch.tensor([0.4, 0.6, 0.3])
    a, b, _ = environment_brdf(cos_view, roughness)
    for i in range(3):
        for f0, expected in ((0.0, b[i]), (1.0, a[i] + b[i])):
            v = torch.tensor([math.sqrt(1 - float(cos_view[i]) ** 2), 0.0, float(cos_view[i])])
            g = sphere_gbuffer(1, roughness=float(roughness[i]), metallic=1.0, base=(f0,) * 3)
            g = GBuffer(**{**vars(g), "normal": torch.tensor([[0.0, 0, 1]]), "view": v[None]})
            found = float(brute_force(g, torch.ones(6, 96, 96, 3))[0, 0])
            assert found == pytest.approx(float(expected), abs=0.012)


def test_the_bundled_table_is_what_integration_gives():
    torch.testing.assert_close(load_tensors(TABLE)["integrals"], integrals(), rtol=1e-9, atol=1e-12)


def test_a_mirror_reflects_as_schlick_says():
    """At roughness 0 the half vector is the normal: A = 1 - (1 - n.v)^5 and B = (1 - n.v)^5."""
    cosine = torch.linspace(0.1, 1, 50)
    a, b, _ = environment_brdf(cosine, torch.zeros(50))
    torch.testing.assert_close(b, (1 - cosine) ** 5, atol=5e-3, rtol=0)
    torch.testing.assert_close(a + b, torch.ones(50), atol=2e-3, rtol=0)


def test_no_more_is_reflected_than_arrives():
    grid = torch.linspace(0, 1, 40)
    cosine, roughness = (x.reshape(-1) for x in torch.meshgrid(grid, grid, indexing="ij"))
    a, b, c = environment_brdf(cosine, roughness)
    assert float(torch.minimum(a, b).min()) >= 0
    assert float((a + b).max()) <= 1 + 1e-5
    assert 0 <= float(c.min()) < float(c.max()) < 0.2
    total = (a + b).reshape(40, 40)[25]  # rough white metal loses light that bounces twice between its facets
    assert (total[8:].diff() < 0).all()


def test_what_fresnel_keeps_from_the_diffuse_part():
    """C by summation over the sphere."""
    light, angle = cubemap.directions(64).reshape(-1, 3), cubemap.solid_angles(64).reshape(-1)
    for cosine in (0.1, 0.4, 0.7, 1.0):
        view = torch.tensor([math.sqrt(1 - cosine**2), 0.0, cosine])
        half = torch.nn.functional.normalize(light + view, dim=1) @ view
        expected = ((1 - half) ** 5 * light[:, 2].clamp(min=0) / math.pi * angle).sum()
        _, _, c = environment_brdf(torch.tensor([cosine]), torch.tensor([0.5]))
        assert float(c) == pytest.approx(float(expected), abs=1e-3)


def test_reflectance_at_the_ends_of_metallic():
    color = torch.rand(7, 3, generator=torch.Generator().manual_seed(0))
    assert torch.equal(base_reflectance(color, torch.ones(7)), color)
    torch.testing.assert_close(base_reflectance(color, torch.zeros(7)), torch.full((7, 3), DIELECTRIC_F0))


def test_gradients():
    random = torch.Generator().manual_seed(1)
    drawn = 0.1 + 0.85 * torch.rand(2, 20, generator=random, dtype=torch.float64)
    cosine, roughness = drawn.requires_grad_()
    assert torch.autograd.gradcheck(environment_brdf, (cosine, roughness))


def test_look_ups_are_bilinear_in_roughness_and_in_the_root_of_the_cosine():
    """Beyond its ends the table goes on as there: cosines below a thousandth count as that."""
    random = np.random.default_rng(0)
    cosine = np.append(random.random(300), [1.0, 1.0, 1.2, 1e-3, 1e-4, -0.5])
    roughness = np.append(random.random(300), [1.0, 0.0, 1.3, 0.5, 0.5, -0.2])
    table = load_tensors(TABLE)["integrals"].numpy().reshape(64, 64, 3)
    y, x = 63 * roughness.clip(0, 1), 63 * np.sqrt(cosine.clip(1e-3, 1))
    i, j = np.minimum(y.astype(int), 62), np.minimum(x.astype(int), 62)
    fy, fx = (y - i)[:, None], (x - j)[:, None]
    above, below = (table[k, j] * (1 - fx) + table[k, j + 1] * fx for k in (i, i + 1))
    expected = above * (1 - fy) + below * fy
    found = environment_brdf(torch.from_numpy(cosine), torch.from_numpy(roughness))
    np.testing.assert_allclose(torch.stack(found, 1).numpy(), expected, rtol=1e-9, atol=1e-12)

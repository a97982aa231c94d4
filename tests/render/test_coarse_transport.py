"""The matrices of the coarse light against the operator they write out."""

import dataclasses
import functools

import numpy as np
import pytest
import torch

from lightprobe.light import cubemap, prefilter
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.asset import rasterize_asset, textured_visibility
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.transport import Transport
from tests.lit_sphere import CPU, glossy_sphere
from tests.shapes import camera_at

CAMERA = camera_at((2.6, 1.4, 1.2), size=32, focal=42.0)


@functools.cache
def gbuffer_of_sphere(*, shadowed: bool):
    sphere = glossy_sphere()
    if shadowed:
        seen = textured_visibility(sphere.mesh, sphere.textures.flat())
        sphere = dataclasses.replace(sphere, visibility=seen)
    return rasterize_asset(sphere, CAMERA, CPU)


@pytest.mark.slow
@pytest.mark.parametrize("shadowed", [False, True], ids=["open", "shadowed"])
def test_matrices_are_the_operator(shadowed):
    gbuffer = gbuffer_of_sphere(shadowed=shadowed)
    light = torch.rand(6, BLOCKS, BLOCKS, 3, generator=torch.Generator().manual_seed(0))
    expected = Transport(gbuffer, prefilter.cached(BLOCKS, CPU)).apply(light)
    matrix = CoarseTransport.of(gbuffer).matrix
    found = torch.einsum("cpk,kc->pc", matrix, light.reshape(-1, 3))
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


def test_the_solve_explains_the_photo_and_a_stronger_pull_stays_nearer_to_the_level():
    gbuffer = gbuffer_of_sphere(shadowed=True)
    light = 0.5 + torch.rand(6, BLOCKS, BLOCKS, 3, generator=torch.Generator().manual_seed(1))
    transport = CoarseTransport.of(gbuffer)
    observed = torch.einsum("cpk,kc->pc", transport.matrix, light.reshape(-1, 3))
    lights = transport.solve(observed, torch.ones_like(observed), torch.tensor(1.0), (10.0, 1e-3))
    renders = (torch.einsum("cpk,kc->pc", transport.matrix, light) for light in lights)
    errors = [float((render - observed).abs().mean()) for render in renders]
    assert errors[1] < 0.01 * float(observed.mean())
    assert errors[1] < 0.2 * errors[0]
    assert float((lights[0] - 1).norm()) < float((lights[1] - 1).norm())


def test_the_solve_is_the_least_squares_of_its_objective():
    """Each channel by itself, with its own weights; one without any has the level everywhere."""
    random = torch.Generator().manual_seed(2)
    matrix = torch.rand(3, 500, 384, generator=random, dtype=torch.float64) ** 8
    observed, weight = torch.rand(2, 500, 3, generator=random, dtype=torch.float64)
    weight[:, 1] = 0
    level, strengths = 0.7, (0.5, 0.02)
    lights = CoarseTransport(matrix).solve(observed, weight, torch.tensor(level), strengths)
    assert lights.shape == (2, 384, 3)
    torch.testing.assert_close(lights[..., 1], torch.full((2, 384), level, dtype=torch.float64))
    angle = cubemap.exact_solid_angles(8).reshape(-1).numpy() / (4 * np.pi)
    for channel in (0, 2):
        a, w = matrix[channel].numpy(), (weight[:, channel] / weight[:, channel].sum()).numpy()
        gain = (w * a.sum(1) ** 2).sum()
        for k, strength in enumerate(strengths):
            pull = np.sqrt(strength * gain * angle)
            rows = np.concatenate([np.sqrt(w)[:, None] * a, np.diag(pull)])
            wanted = np.concatenate([np.sqrt(w) * observed[:, channel].numpy(), pull * level])
            expected = np.linalg.lstsq(rows, wanted, rcond=None)[0]
            np.testing.assert_allclose(lights[k, :, channel].numpy(), expected, rtol=0, atol=1e-4)


def test_where_nothing_is_open_no_light_arrives():
    gbuffer = gbuffer_of_sphere(shadowed=True)
    table = torch.zeros_like(gbuffer.visibility.vertices.unoccluded)
    vertices = dataclasses.replace(gbuffer.visibility.vertices, unoccluded=table)
    seen = dataclasses.replace(gbuffer.visibility, vertices=vertices)
    closed = dataclasses.replace(gbuffer, visibility=seen)
    assert float(CoarseTransport.of(closed).matrix.abs().max()) == 0

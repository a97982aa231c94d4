"""The matrices of the coarse light against the operator they write out."""

import dataclasses

import pytest
import torch

from lightprobe.light import prefilter
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.asset import rasterize_asset, textured_visibility
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.transport import Transport
from tests.lit_sphere import CPU, glossy_sphere
from tests.shapes import camera_at

CAMERA = camera_at((2.6, 1.4, 1.2), size=32, focal=42.0)


def gbuffers():
    plain = glossy_sphere()
    shaded = dataclasses.replace(plain, visibility=textured_visibility(plain.mesh, plain.textures.flat()))
    return [rasterize_asset(asset, CAMERA, CPU) for asset in (plain, shaded)]


@pytest.mark.parametrize("gbuffer", gbuffers(), ids=["open", "shadowed"])
def test_matrices_are_the_operator(gbuffer):
    light = torch.rand(6, BLOCKS, BLOCKS, 3, generator=torch.Generator().manual_seed(0))
    expected = Transport(gbuffer, prefilter.cached(BLOCKS, CPU)).apply(light)
    matrix = CoarseTransport.of(gbuffer).matrix
    found = torch.einsum("cpk,kc->pc", matrix, light.reshape(-1, 3))
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


def test_the_solve_explains_the_photo_and_a_stronger_pull_stays_nearer_to_the_level():
    gbuffer = gbuffers()[1]
    light = 0.5 + torch.rand(6, BLOCKS, BLOCKS, 3, generator=torch.Generator().manual_seed(1))
    transport = CoarseTransport.of(gbuffer)
    observed = torch.einsum("cpk,kc->pc", transport.matrix, light.reshape(-1, 3))
    lights = transport.solve(observed, torch.ones_like(observed), torch.tensor(1.0), (10.0, 1e-3))
    errors = [float((torch.einsum("cpk,kc->pc", transport.matrix, e) - observed).abs().mean()) for e in lights]
    assert errors[1] < 0.01 * float(observed.mean())
    assert errors[1] < 0.2 * errors[0]
    assert float((lights[0] - 1).norm()) < float((lights[1] - 1).norm())

"""Occluded light: against the plain reference and a closed form, by gradcheck, and bit by bit."""

import pytest
import torch
from torch.autograd import gradcheck

from lightprobe.kernels import occluded_light, occlusion_weights
from lightprobe.kernels.reference import occlusion as reference
from lightprobe.light import cubemap
from tests.threads import assert_same_bits


def problem(pixels=700, rows=50, corners=3, resolution=8, dtype=torch.float32, seed=0):
    """Return light, normals, unoccluded, index, weight, directions and solid angles."""
    random = torch.Generator().manual_seed(seed)
    directions = cubemap.exact_directions(resolution).reshape(-1, 3)
    angles = cubemap.exact_solid_angles(resolution).reshape(-1)
    light = torch.rand(len(directions), 3, generator=random, dtype=torch.float64) ** 4
    normals = torch.randn(pixels, 3, generator=random, dtype=torch.float64)
    normals = torch.nn.functional.normalize(normals, dim=1)
    unoccluded = torch.randint(0, 256, (rows, len(directions)), generator=random, dtype=torch.uint8)
    index = torch.randint(0, rows, (pixels, corners), generator=random)
    weight = torch.rand(pixels, corners, generator=random, dtype=torch.float64)
    weight = weight / weight.sum(1, keepdim=True)
    case = light, normals, unoccluded, index, weight, directions, angles
    return tuple(x.to(dtype) if x.is_floating_point() else x for x in case)


def value_and_gradients(case, grad):
    light, normals = case[0].clone().requires_grad_(), case[1].clone().requires_grad_()
    out = occluded_light(light, normals, *case[2:])
    return out.detach(), *torch.autograd.grad(out, (light, normals), grad)


@pytest.mark.parametrize(("pixels", "corners"), [(700, 3), (1, 1), (257, 2)])
def test_matches_the_reference(backend, pixels, corners):
    pixels = backend.size(pixels, min(pixels, 30))
    case = backend.move(*problem(pixels, corners=corners))
    grad = torch.randn(pixels, 7, device=backend.device)
    ours = value_and_gradients(case, grad)
    exact = [x.double() if x.is_floating_point() else x for x in case]
    theirs = value_and_gradients(exact, grad.double())
    torch.testing.assert_close(ours[0].double(), theirs[0], rtol=1e-5, atol=1e-5)
    for mine, true in zip(ours[1:], theirs[1:], strict=True):
        torch.testing.assert_close(mine.double(), true, rtol=1e-4, atol=1e-4 * float(true.abs().max()))


def test_gradients_in_float64():
    light, normals, *rest = problem(4, 5, resolution=4, dtype=torch.float64)
    variables = light.requires_grad_(), normals.requires_grad_()
    assert gradcheck(lambda a, n: occluded_light(a, n, *rest), variables)


def test_open_sky_is_irradiance_over_pi():
    _, _, unoccluded, *rest = problem(50, dtype=torch.float64, resolution=32)
    up = rest[2][:, 2:].clamp(min=0).expand(-1, 3)  # a light max(w_z, 0): irradiance / pi of n = z is 2 / 3
    normals = torch.tensor([[0.0, 0, 1]]).double().expand(50, 3)
    out = occluded_light(up.contiguous(), normals, torch.full_like(unoccluded, 255), *rest)
    torch.testing.assert_close(out[:, 0], torch.full((50,), 2 / 3).double(), rtol=2e-3, atol=0)
    torch.testing.assert_close(out[:, 3], torch.full((50,), 1 / 4).double(), rtol=2e-3, atol=0)
    torch.testing.assert_close(out[:, 6], torch.ones(50).double())


@pytest.mark.parametrize(("resolution", "pixels"), [(3, 300), (8, 300), (8, 1)])
def test_weights_are_the_light_written_out(backend, resolution, pixels):
    pixels = backend.size(pixels, min(pixels, 40))
    case = backend.move(*problem(pixels, resolution=resolution))
    light = torch.randn(6 * resolution**2, 3, device=backend.device)
    expected = occluded_light(light, *case[1:])
    diffuse, ambient = occlusion_weights(*case[1:])
    torch.testing.assert_close(diffuse @ light, expected[:, :3], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(ambient @ light, expected[:, 3:6], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(diffuse.sum(1), expected[:, 6], rtol=1e-4, atol=1e-5)


def test_the_reference_slabs_change_nothing(monkeypatch):
    case = problem(40, dtype=torch.float64)
    whole = reference.occluded_light(*case), occlusion_weights(*case[1:])
    monkeypatch.setattr(reference, "PAIRS_AT_ONCE", 1000)
    torch.testing.assert_close((reference.occluded_light(*case), occlusion_weights(*case[1:])), whole)


def test_bits_do_not_depend_on_threads():
    case, grad = problem(3000), torch.randn(3000, 7)
    assert_same_bits(lambda: (*value_and_gradients(case, grad), occlusion_weights(*case[1:])))


def test_refuses_what_cannot_be():
    light, normals, unoccluded, index, *rest = problem(5)
    with pytest.raises(ValueError, match="unoccluded must be uint8"):
        occluded_light(light, normals, unoccluded.float(), index, *rest)
    with pytest.raises(IndexError, match="index"):
        occluded_light(light, normals, unoccluded, index + 50, *rest)
    with pytest.raises(IndexError, match="index"):
        occlusion_weights(normals, unoccluded, index + 50, *rest)

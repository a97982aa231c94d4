"""Stacking: against the plain reference and the printed equation, by gradcheck, bit by bit, and at its edges."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.autograd import gradcheck

from lightprobe.kernels import probe_weight, stack_probes
from lightprobe.kernels.reference import stacking as reference
from tests.threads import assert_same_bits


def unit(count, random):
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=random, dtype=torch.float64), dim=1)


def problem(pixels=700, texels=900, *, least_roughness=0.08, seed=0, dtype=torch.float32):
    """Return colours, normals, views on the normals' side, alpha^2 and directions."""
    random = torch.Generator().manual_seed(seed)
    normals, views, directions = unit(pixels, random), unit(pixels, random), unit(texels, random)
    views = views * (normals * views).sum(dim=1, keepdim=True).sign()
    share = torch.rand(pixels, generator=random, dtype=torch.float64)
    roughness = least_roughness + (1 - least_roughness) * share
    colors = torch.rand(pixels, 3, generator=random, dtype=torch.float64) * 2
    return tuple(x.to(dtype) for x in (colors, normals, views, roughness**4, directions))


def exact(colors, *lobes):
    """Return radiance and weight in float64."""
    total, weight = reference.stack(colors.double(), *(x.double() for x in lobes))
    return total / weight[:, None].clamp(min=1e-300), weight


def value_and_gradient(case, grad):
    colors = case[0].clone().requires_grad_()
    radiance, weight = stack_probes(colors, *case[1:])
    return radiance.detach(), weight, *torch.autograd.grad(radiance, colors, grad)


def test_reference_is_the_printed_equation():
    _, n, v, a2, w = problem(40, 50, dtype=torch.float64)
    half = w[None] + v[:, None]
    half = half / half.norm(dim=2, keepdim=True)
    n_h = (n[:, None] * half).sum(dim=2)
    printed = a2[:, None] / (math.pi * (n_h**2 * (a2[:, None] - 1) + 1) ** 2) * (n @ w.T).clamp(min=0)
    torch.testing.assert_close(reference.distribution(n, v, a2, w), printed, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("pixels", "texels"), [(700, 900), (1, 1), (3, 257), (513, 16)])
def test_matches_the_reference(backend, pixels, texels):
    pixels, texels = backend.size(pixels, min(pixels, 70)), backend.size(texels, min(texels, 300))
    case = backend.move(*problem(pixels, texels))
    grad = torch.randn(texels, 3, device=backend.device)
    radiance, weight, grad_colors = value_and_gradient(case, grad)
    expected, expected_weight = exact(*case)
    least = 1e-5 * float(expected_weight.max())
    torch.testing.assert_close(weight.double(), expected_weight, rtol=3e-5, atol=least)
    torch.testing.assert_close(radiance.double(), expected, rtol=1e-5, atol=1e-5)
    colors = case[0].double().requires_grad_()
    (expected_grad,) = torch.autograd.grad(exact(colors, *case[1:])[0], colors, grad.double())
    least = 1e-4 * float(expected_grad.abs().max())
    torch.testing.assert_close(grad_colors.double(), expected_grad, rtol=1e-4, atol=least)


def test_gradient_in_float64():
    colors, *lobes = problem(5, 9, dtype=torch.float64)
    assert gradcheck(lambda c: stack_probes(c, *lobes)[0], (colors.requires_grad_(),))


def test_the_core_of_a_sharp_lobe_keeps_its_digits(backend):
    case = backend.move(*problem(300, 1, least_roughness=0.08))
    n, v = case[1], case[2]
    mirror = torch.nn.functional.normalize(2 * (n * v).sum(dim=1, keepdim=True) * n - v, dim=1)
    beside = torch.randn(300, 3, generator=torch.Generator().manual_seed(1)).to(mirror)
    offset = torch.nn.functional.normalize(mirror + 0.005 * beside, dim=1)
    a2 = torch.full((300,), 0.08**4, device=backend.device)
    for p in range(0, 300, 7):
        lobe = [x[p : p + 1] for x in (n, v, a2)]
        expected = exact(case[0][:1], *lobe, offset[p : p + 1])[1]
        found = probe_weight(*lobe, offset[p : p + 1]).double()
        torch.testing.assert_close(found, expected, rtol=2e-4, atol=0)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 30), st.integers(1, 30), st.integers(0, 1000), st.floats(0.08, 1))
def test_radiance_is_a_convex_average(pixels, texels, seed, roughness):
    colors, n, v, _, w = problem(pixels, texels, seed=seed)
    radiance, weight = stack_probes(colors, n, v, torch.full((pixels,), roughness**4), w)
    seen = weight > 0
    assert (radiance[seen] <= colors.amax(dim=0) + 1e-5).all()
    assert (radiance[seen] >= colors.amin(dim=0) - 1e-5).all()
    assert not radiance[~seen].any()


def test_unseen_directions_are_black_and_give_no_gradient(backend):
    n, v = torch.tensor([[0.0, 0, 1], [0, 0, 1]]), torch.tensor([[0.0, 0, 1], [0, 0.6, 0.8]])
    down, up = backend.move(torch.tensor([[0.0, 0.6, -0.8]]), torch.tensor([[0.0, 0.6, 0.8]]))
    case = (*backend.move(torch.ones(2, 3), n, v, torch.tensor([0.1, 0.1])), down)
    one = torch.ones(1, 3, device=backend.device)
    radiance, weight, grad = value_and_gradient(case, one)
    assert not torch.cat([radiance.flatten(), weight, grad.flatten()]).any()
    radiance, weight, grad = value_and_gradient((*case[:4], up), one)
    torch.testing.assert_close(radiance, one)
    torch.testing.assert_close(float(grad.sum()), 3.0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_direction_opposite_to_the_view_is_finite(backend, dtype):
    n = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], dtype=dtype)
    v = torch.tensor([[0.0, 0.6, 0.8]] * 2, dtype=dtype)  # the second pixel faces away from its camera
    a2 = torch.tensor([0.3, 0.3], dtype=dtype)
    case = backend.move(torch.ones_like(n), n, v, a2, -v[:1])
    radiance, weight = (x.cpu() for x in stack_probes(*case))
    torch.testing.assert_close(weight, torch.tensor([0.3 / math.pi * 0.8], dtype=dtype), rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(radiance, torch.ones(1, 3, dtype=dtype))


@pytest.mark.parametrize("a2", [0.05, 0.3, 1.0])
def test_the_density_integrates_to_its_closed_form(a2):
    """For v = n, dw = 4 (n.h) dh, and a share 1/(1 + a2) of GGX's half vectors is within 45 degrees: n.w > 0."""
    count = 200_000
    k = torch.arange(count, dtype=torch.float64) + 0.5
    z, phi = 1 - 2 * k / count, k * math.pi * (3 - math.sqrt(5))
    radius = (1 - z * z).sqrt()
    upper = torch.stack([radius * phi.cos(), radius * phi.sin(), z], dim=1).float()[: count // 2]
    n = torch.tensor([[0.0, 0.0, 1.0]])
    density = probe_weight(n, n, torch.tensor([a2]), upper).double() / upper[:, 2]
    assert float(density.sum() * 4 * math.pi / count / 4) == pytest.approx(1 / (1 + a2), rel=1e-3)


def test_probe_weight_is_the_weight():
    colors, *lobes = problem()
    assert torch.equal(probe_weight(*lobes), stack_probes(colors, *lobes)[1])
    assert not stack_probes(colors.requires_grad_(), *lobes)[1].requires_grad


def test_same_bits_again_and_on_one_thread(backend):
    pixels, texels = backend.size(1500, 70), backend.size(1100, 70)
    case, grad = backend.move(*problem(pixels, texels)), torch.randn(texels, 3, device=backend.device)
    assert_same_bits(lambda: value_and_gradient(case, grad))


def test_a_broken_normal_shows(backend):
    colors, n, v, a2, w = backend.move(*problem(3, 5))
    n[1, 0] = math.nan
    assert stack_probes(colors, n, v, a2, w)[0].isnan().all()


def test_no_pixels_or_no_texels(backend):
    colors, n, v, a2, w = backend.move(*problem(4, 4))
    radiance, weight = stack_probes(colors[:0], n[:0], v[:0], a2[:0], w)
    assert not torch.cat([radiance.flatten(), weight]).any()
    assert stack_probes(colors, n, v, a2, w[:0])[0].shape == (0, 3)


def test_wrong_input_is_refused():
    colors, n, v, a2, w = problem(4, 4)
    for words, case in {
        "colors must have shape": (colors[:, :2], n, v, a2, w),
        "views must have shape": (colors, n, v[:3], a2, w),
        "share a device and a floating dtype": (colors, n, v.double(), a2, w),
    }.items():
        with pytest.raises(ValueError, match=words):
            stack_probes(*case)

import math

import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.prefilter import DRAFT, cached

R = 8


def random_light(seed: int = 0) -> torch.Tensor:
    return torch.rand(6, R, R, 3, generator=torch.Generator().manual_seed(seed))


def level_lookup(levels, taps):
    index, weight = taps
    return (levels[index.long()] * weight[..., None]).sum(1)


def test_a_constant_light_stays_constant():
    levels = cached(R).apply(torch.full((6, R, R, 3), 0.7))
    assert (levels - 0.7).abs().max() < 1e-5


def test_adjoint_is_the_transpose():
    operator = cached(R)
    light = random_light().double().float()
    levels = operator.apply(light)
    other = torch.rand(levels.shape, generator=torch.Generator().manual_seed(1))
    left, right = float((levels * other).double().sum()), float((light * operator.adjoint(other)).double().sum())
    assert left == pytest.approx(right, rel=1e-5)


def test_a_draft_holds_fewer_entries_and_says_nearly_the_same():
    exact, draft = cached(32), cached(32, accuracy=DRAFT)
    light = torch.rand(6, 32, 32, 3, generator=torch.Generator().manual_seed(0)) ** 4
    assert len(draft.lobes.forward.value) < 0.7 * len(exact.lobes.forward.value)
    error = (draft.apply(light) - exact.apply(light)).abs()[exact.levels[3].offset : exact.first_block]
    assert 0 < float(error.mean()) < 0.02 * float(light.mean())
    assert cached(32, accuracy=DRAFT) is draft
    assert cached(32) is exact


def test_the_dense_levels_are_the_operator():
    operator, light = cached(R), random_light()
    levels = (operator.dense_levels() @ light.reshape(-1, 3)).contiguous()
    assert torch.allclose(levels, operator.apply(light)[: operator.first_block], atol=1e-6)


def test_gradient_is_the_adjoint():
    operator, light = cached(R), random_light().requires_grad_()
    other = torch.rand(operator.total, 3, generator=torch.Generator().manual_seed(2))
    (operator.apply(light) * other).sum().backward()
    assert torch.allclose(light.grad, operator.adjoint(other), atol=1e-6)


def test_diffuse_level_is_the_cosine_integral():
    """Irradiance / pi against a sum over the light's own texels, in directions off every grid."""
    light = random_light(3)
    normals = torch.nn.functional.normalize(torch.randn(50, 3, generator=torch.Generator().manual_seed(4)), dim=1)
    cosine = (cubemap.directions(R).reshape(1, -1, 3) * normals[:, None]).sum(-1).clamp(min=0)
    weight = cosine * cubemap.solid_angles(R).reshape(1, -1) / math.pi
    operator = cached(R)
    looked_up = level_lookup(operator.apply(light), operator.diffuse_taps(normals))
    assert (looked_up - weight @ light.reshape(-1, 3)).abs().max() < 0.01


@pytest.mark.parametrize("roughness", [0.2, 0.35, 0.5, 0.8])
def test_specular_level_is_the_lobe_average(roughness):
    """Against the definition: the mean of the light under D(h) n.l with v = n, by direct summation."""
    smooth = cubemap.directions(32)
    fine = torch.stack([1 + smooth[..., 0], 1 + smooth[..., 1] * smooth[..., 2], 1 + smooth[..., 2]], -1)
    operator = cached(32)
    normals = torch.nn.functional.normalize(torch.randn(40, 3, generator=torch.Generator().manual_seed(5)), dim=1)
    cosine = (smooth.reshape(1, -1, 3) * normals[:, None]).sum(-1)
    half = ((1 + cosine) / 2).clamp(0, 1)
    lobe = cosine.clamp(min=0) / (half * (roughness**4 - 1) + 1) ** 2 * cubemap.solid_angles(32).reshape(1, -1)
    expected = lobe @ fine.reshape(-1, 3) / lobe.sum(1, keepdim=True)
    taps = operator.specular_taps(normals, torch.full((40,), roughness))
    assert (level_lookup(operator.apply(fine), taps) - expected).abs().max() < 0.03


def test_specular_taps_sum_to_one_and_are_smooth_in_roughness():
    operator = cached(R)
    direction = torch.nn.functional.normalize(torch.tensor([[0.2, 0.4, -0.7]] * 3), dim=1)
    _, weight = operator.specular_taps(direction, torch.tensor([0.0, 0.33, 1.0]))
    assert torch.allclose(weight.sum(1), torch.ones(3), atol=1e-5)

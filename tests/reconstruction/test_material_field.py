"""The first pass's material: its field, one factor on all base colours, and what it costs."""

import math
from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.light.prefilter import MIN_ROUGHNESS
from lightprobe.reconstruction.losses import BRIGHTNESS_ANCHOR, ROUGHNESS_PRIOR, USUAL_ROUGHNESS
from lightprobe.reconstruction.material_field import (
    START_BASE,
    MaterialField,
    ScaledMaterial,
    activate,
    level_resolutions,
)

CPU = torch.device("cpu")
CONFIG = DecomposeConfig(hash_levels=4, hash_finest=32)


def points(count=200):
    return 2 * torch.rand(count, 3, generator=torch.Generator().manual_seed(0)) - 1


def test_the_factor_scales_base_colours_alone():
    material = ScaledMaterial(0.3, CONFIG, CPU, 0)
    field = material.field(points())
    found = material(points())
    torch.testing.assert_close(found[:, :3], field[:, :3] * 0.3 / START_BASE)
    assert torch.equal(found[:, 3:], field[:, 3:])
    assert float(material.mean_color) == pytest.approx(0.3)
    assert [name for name, _ in material.named_parameters() if "brightness" in name] == []


def test_beyond_white_is_white_with_a_gradient():
    material = ScaledMaterial(START_BASE * 10, CONFIG, CPU, 0)
    color = material(points())[:, :3]
    assert float(color.detach().max()) == 1
    color.sum().backward()
    assert (material.field.biases[-1].grad[:3] > 0).all()


def test_taking_over_keeps_the_parameters_that_an_optimiser_holds():
    one, other = ScaledMaterial(0.3, CONFIG, CPU, 0), ScaledMaterial(0.1, CONFIG, CPU, 1)
    held = list(one.parameters())
    one.take_over(other)
    assert all(a is b for a, b in zip(held, one.parameters(), strict=True))
    assert torch.equal(one(points()), other(points()))
    assert float(one.mean_color) == pytest.approx(0.1)


def test_a_usual_material_costs_nothing_and_every_oddity_something():
    """Each term alone, against its definition, of an even field."""
    usual = torch.tensor([0.2, 0.2, 0.2, USUAL_ROUGHNESS, 0.0, 0.0, 0.0, 0.0]).expand(200, 8)

    def cost(material, **weights):
        off = replace(CONFIG, metallic_prior=0.0, normal_prior=0.0, priors=False)
        model = ScaledMaterial(START_BASE, replace(off, **weights), CPU, 0)
        model.forward = lambda points: material[: len(points)]
        return float(model.loss(points(), material, 0, 0.5).detach())

    assert cost(usual, metallic_prior=1.0, normal_prior=1.0, priors=True) == pytest.approx(0, abs=1e-12)
    odd = usual + torch.tensor([0.0, 0, 0, 0.3, 0.5, 0, 0.2, 0])
    assert cost(odd) == 0
    assert cost(odd, priors=True) == pytest.approx(0.09 * ROUGHNESS_PRIOR)
    assert cost(odd, metallic_prior=1.0) == pytest.approx(0.5)
    assert cost(odd, normal_prior=1.0) == pytest.approx(0.04 / 3)
    brighter = usual * torch.tensor([2.0, 2, 2, 1, 1, 1, 1, 1])
    assert cost(brighter, priors=True) == pytest.approx(BRIGHTNESS_ANCHOR * math.log(2.0) ** 2)


def test_smoothness_is_the_change_beside():
    """A new field hardly changes over a hundredth; with random tables it does."""
    config = replace(CONFIG, metallic_prior=0.0, priors=False, normal_prior=0.0)
    material, costs = ScaledMaterial(START_BASE, config, CPU, 0), []
    for size, step in ((1e-4, 0), (1.0, 0), (1.0, 0), (1.0, 1)):
        with torch.no_grad():
            material.field.table.normal_(generator=torch.Generator().manual_seed(0)).mul_(size)
        costs.append(float(material.loss(points(), material(points()), step, 0.5).detach()))
    assert 0 < costs[0] < 0.1 * costs[1]
    assert costs[1] == costs[2] != costs[3]  # of step and seed alone


def test_what_is_held_is_given_and_not_stored():
    material, other = ScaledMaterial(0.3, CONFIG, CPU, 0), ScaledMaterial(0.3, CONFIG, CPU, 1)
    material.held = [
        lambda _, channels: torch.cat([channels[:, :4], torch.ones_like(channels[:, :1]), channels[:, 5:]], 1)
    ]
    assert (material(points())[:, 4] == 1).all()
    other.take_over(material)
    assert not (other(points())[:, 4] == 1).any()
    assert torch.equal(other(points())[:, :4], material(points())[:, :4])


def field(seed=0, **change):
    config = DecomposeConfig(hash_levels=4, hash_log2_size=8, hash_finest=32)
    return MaterialField(replace(config, **change), torch.Generator().manual_seed(seed))


def test_any_numbers_become_a_valid_material():
    raw = 5 * torch.randn(100, 8, generator=torch.Generator().manual_seed(0))
    material = activate(
        torch.cat([raw, torch.zeros(1, 8), torch.full((1, 8), 1e4), torch.full((1, 8), -1e4)])
    )
    assert 0 <= float(material[:, :5].min()) <= float(material[:, :5].max()) <= 1
    assert float(material[:, 3].min()) == pytest.approx(MIN_ROUGHNESS)
    assert float(material[:, 5:].abs().max()) == pytest.approx(0.5)


def test_resolutions_are_a_geometric_ladder():
    assert level_resolutions(4, 16, 128).tolist() == [16, 32, 64, 128]
    assert level_resolutions(1, 12, 256).tolist() == [12]
    ladder = level_resolutions(8, 12, 256)
    assert ladder[0] == 12
    assert ladder[-1] == 256
    ratio = ladder[1:] / ladder[:-1]
    assert float(ratio.max() / ratio.min()) < 1.1


def test_a_new_field_is_dark_grey_half_rough_and_a_third_metallic():
    material = field()(points()).detach()
    mean = material.mean(0)
    torch.testing.assert_close(mean[:3], torch.full((3,), START_BASE), atol=0.02, rtol=0)
    assert float(mean[3]) == pytest.approx((1 + MIN_ROUGHNESS) / 2, abs=0.03)
    assert float(mean[4]) == pytest.approx(0.3, abs=0.03)
    assert float(material[:, 5:].abs().max()) < 0.1


def test_equal_generators_make_equal_fields():
    one, again, other = (field(seed)(points()) for seed in (1, 1, 2))
    assert torch.equal(one, again)
    assert not torch.equal(one, other)


def test_beyond_the_cube_its_border_goes_on():
    material = field()
    inside, beyond = points(), points() * 5
    torch.testing.assert_close(material(beyond), material(beyond.clamp(-1.2, 1.2)))
    assert not torch.equal(material(inside), material(inside.clamp(-0.5, 0.5)))


def test_gradients_reach_table_network_and_points():
    material, at = (
        field(hash_levels=2, hash_log2_size=4, hash_finest=16).double(),
        points(7).double().requires_grad_(),
    )
    names, values = zip(*material.named_parameters(), strict=True)

    def shown(at, *values):
        return torch.func.functional_call(material, dict(zip(names, values, strict=True)), (at,))

    with torch.no_grad():
        material.table.normal_(generator=torch.Generator().manual_seed(3))  # far from relu's kinks at zero
    values = tuple(value.detach().requires_grad_() for value in values)
    assert torch.autograd.gradcheck(shown, (at, *values), fast_mode=True)

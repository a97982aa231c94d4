"""The first pass's material: one factor on all base colours, and what the material costs."""

from dataclasses import replace

import pytest
import torch
from lightprobe.material.field import START_BASE
from lightprobe.reconstruction.scaled_material import ScaledMaterial

from lightprobe.core.config import DecomposeConfig
from lightprobe.reconstruction.losses import USUAL_ROUGHNESS

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


def test_a_usual_even_material_costs_nothing_and_every_oddity_something():
    """Each term alone, against its definition."""
    off = replace(
        CONFIG,
        smoothness=0.0,
        metallic_prior=0.0,
        roughness_prior=0.0,
        brightness_anchor=0.0,
        normal_prior=0.0,
    )
    usual = torch.tensor([0.2, 0.2, 0.2, USUAL_ROUGHNESS, 0.0, 0.0, 0.0, 0.0]).expand(200, 8)

    def cost(material, **weights):
        model = ScaledMaterial(START_BASE, replace(off, **weights), CPU, 0)
        return float(model.loss(points(), material, 0, 0.5).detach())

    everything = {
        "metallic_prior": 1.0,
        "roughness_prior": 1.0,
        "brightness_anchor": 1.0,
        "normal_prior": 1.0,
    }
    assert cost(usual, **everything) == pytest.approx(0, abs=1e-12)
    odd = usual + torch.tensor([0.0, 0, 0, 0.3, 0.5, 0, 0.2, 0])
    assert cost(odd) == 0
    assert cost(odd, roughness_prior=1.0) == pytest.approx(0.09)
    assert cost(odd, metallic_prior=1.0) == pytest.approx(0.5)
    assert cost(odd, normal_prior=1.0) == pytest.approx(0.04 / 3)
    brighter = usual * torch.tensor([2.0, 2, 2, 1, 1, 1, 1, 1])
    assert cost(brighter, brightness_anchor=1.0) == pytest.approx(torch.log(torch.tensor(2.0)).item() ** 2)


def test_smoothness_is_the_change_beside():
    """A new field hardly changes over a hundredth; with random tables it does."""
    config = replace(CONFIG, metallic_prior=0.0, roughness_prior=0.0, brightness_anchor=0.0, normal_prior=0.0)
    material = ScaledMaterial(START_BASE, replace(config, smoothness=1.0), CPU, 0)
    costs = []
    for size in (1e-4, 1.0):
        with torch.no_grad():
            material.field.table.normal_(generator=torch.Generator().manual_seed(0)).mul_(size)
        costs.append(float(material.loss(points(), material(points()), 0, 0.5).detach()))
    assert 0 < costs[0] < 0.1 * costs[1]
    assert costs[1] == float(
        material.loss(points(), material(points()), 0, 0.5).detach()
    )  # of step and seed alone
    assert costs[1] != float(material.loss(points(), material(points()), 1, 0.5).detach())


def test_what_is_held_is_given_and_not_stored():
    material, other = ScaledMaterial(0.3, CONFIG, CPU, 0), ScaledMaterial(0.3, CONFIG, CPU, 1)
    material.held = [
        lambda _, channels: torch.cat([channels[:, :4], torch.ones_like(channels[:, :1]), channels[:, 5:]], 1)
    ]
    assert (material(points())[:, 4] == 1).all()
    other.take_over(material)
    assert not (other(points())[:, 4] == 1).any()
    assert torch.equal(other(points())[:, :4], material(points())[:, :4])

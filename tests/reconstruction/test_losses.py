"""What the losses of Phase I prefer: clipped pixels, usual materials, grey lights."""

import numpy as np
import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.reconstruction.losses import (
    USUAL_ROUGHNESS,
    brightness_anchor,
    color_gauge,
    image_loss,
    material_prior,
    metal_parsimony,
    neighbour_difference,
)
from lightprobe.reconstruction.photos import Target
from lightprobe.render.surface import View
from tests.shapes import camera_at


def material(base: float, roughness: float, metallic: float) -> torch.Tensor:
    return torch.tensor([[base, base, base, roughness, metallic]]).repeat(10, 1).requires_grad_()


def test_the_usual_dielectric_costs_nothing():
    assert (
        float(material_prior(material(0.3, USUAL_ROUGHNESS, 0.0).detach(), DecomposeConfig(), decided=False))
        < 1e-9
    )


def test_unusual_materials_are_pulled_back():
    value = material(0.3, 0.1, 0.5)
    material_prior(value, DecomposeConfig(), decided=False).backward()
    assert value.grad is not None
    assert (value.grad[:, :3] == 0).all()
    assert (value.grad[:, 3] < 0).all()  # rougher
    assert (value.grad[:, 4] > 0).all()  # less metallic


def test_a_metal_darker_than_the_rest_goes_nearly_free():
    value = torch.cat([material(0.02, 0.4, 0.5), material(0.5, 0.4, 0.5)]).detach().requires_grad_()
    material_prior(value, DecomposeConfig(), decided=False).backward()
    assert value.grad is not None
    dark, bright = value.grad[:10, 4], value.grad[10:, 4]
    assert (dark > 0).all()
    assert (dark < 0.3 * bright).all()
    brightness_of_all = torch.tensor([0.1] * 3 + [1.0] * 2)
    assert torch.isclose(
        material_prior(value.detach() * brightness_of_all, DecomposeConfig(), decided=False),
        material_prior(value.detach(), DecomposeConfig(), decided=False),
    )


def test_once_it_is_decided_what_is_metal_it_costs_to_be_neither():
    value = torch.cat([material(0.3, 0.4, 0.2), material(0.3, 0.4, 0.8)]).detach().requires_grad_()
    material_prior(value, DecomposeConfig(), decided=True).backward()
    assert value.grad is not None
    assert (value.grad[:10, 4] > 0).all()
    assert (value.grad[10:, 4] < 0).all()
    whole = material(0.3, USUAL_ROUGHNESS, 1.0).detach()
    assert float(material_prior(whole, DecomposeConfig(), decided=True)) < 1e-9
    dark = torch.cat([material(0.02, 0.4, 0.8), material(0.5, 0.4, 0.8)]).detach().requires_grad_()
    material_prior(dark, DecomposeConfig(), decided=True).backward()
    assert dark.grad is not None
    assert (dark.grad[:10, 4] > 0).all()  # soot and leather are no metals


def test_once_it_is_decided_what_is_metal_only_that_is_still_pulled_to_a_usual_roughness():
    config = DecomposeConfig(metallic_prior=0.0, roughness_prior=0.5, late_roughness_prior=0.125)

    def cost(metallic: float, *, decided: bool) -> float:
        matte = material(0.3, USUAL_ROUGHNESS + 0.4, metallic).detach()
        return float(material_prior(matte, config, decided=decided)) / 0.4**2

    assert cost(0.0, decided=False) == cost(1.0, decided=False) == pytest.approx(0.5)
    assert cost(0.0, decided=True) == pytest.approx(0.125)
    assert cost(1.0, decided=True) == pytest.approx(0.5)
    between = material(0.3, USUAL_ROUGHNESS + 0.4, 0.5)
    material_prior(between, config, decided=True).backward()
    assert between.grad is not None
    assert (between.grad[:, 4] == 0).all()  # being rough is no reason to be less of a metal


def test_metals_of_few_colours_cost_less():
    rough = torch.full((60,), 0.3)
    metal = torch.ones(60)
    two = torch.tensor([0.2, 0.7]).repeat_interleave(30)[:, None].expand(60, 3)
    many = torch.linspace(0.2, 0.7, 60)[:, None].expand(60, 3)
    cost = metal_parsimony(many, rough, metal)
    assert abs(float(metal_parsimony(many[:1].expand(60, 3), rough, metal))) < 1e-5
    assert np.isclose(
        float(metal_parsimony(two, rough, metal)), np.log(2), rtol=1e-3
    )  # halves that share nothing
    assert float(cost) > np.log(2)
    assert torch.isclose(metal_parsimony(many, rough, 0.5 * metal), 0.5 * cost)
    assert float(metal_parsimony(many, rough, 0 * metal)) == 0  # paint may have any pattern


def test_a_metal_of_another_colour_is_drawn_to_the_others():
    base = torch.full((50, 3), 0.4)
    base[0] = 0.3
    base.requires_grad_()
    metal_parsimony(base, torch.full((50,), 0.3), torch.ones(50)).backward()
    assert base.grad is not None
    assert (base.grad[0] < 0).all()
    assert (base.grad[0].abs() > 10 * base.grad[1].abs()).all()


def test_the_mean_base_colour_is_held():
    assert (
        float(brightness_anchor(torch.tensor([[0.1, 0.2, 0.4], [0.3, 0.2, 0.0]]), torch.tensor(0.2))) < 1e-9
    )
    assert float(brightness_anchor(torch.full((3, 3), 0.4), torch.tensor(0.2))) > 0.4


def test_a_red_cast_of_all_lights_is_moved_to_the_surface():
    base = torch.full((5, 3), 0.3, requires_grad=True)
    color_gauge(base, torch.tensor([0.2, -0.1, -0.1])).backward()
    assert base.grad is not None
    red, green, blue = (-base.grad).sum(0)  # the step of descent
    assert red > 0
    assert green < 0
    assert blue < 0
    assert torch.isclose(red + green + blue, torch.tensor(0.0), atol=1e-6)  # brightness stays


def test_missing_coverage_costs_whatever_the_colour():
    photo, alpha, cpu = torch.full((4, 3), 0.3), torch.ones(4), torch.device("cpu")
    target = Target(
        "grey", View.of(camera_at((3, 0, 0)), cpu), photo, alpha, torch.zeros(4, 3, dtype=torch.bool)
    )
    background = torch.tensor([0.3, 0.3, 0.3])  # the hole looks like the object
    full = image_loss(photo, alpha, target, background, 4.0)
    hole = torch.tensor([1.0, 1.0, 1.0, 0.0])
    assert float(full) < 1e-6
    assert float(image_loss(photo * hole[:, None], hole, target, background, 4.0)) > 0.9


def test_the_difference_of_neighbours_and_its_gradient():
    maps = torch.rand(
        5, 7, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)
    ).requires_grad_()
    plain = (maps[:, 1:] - maps[:, :-1]).abs().mean() + (maps[1:] - maps[:-1]).abs().mean()
    assert torch.isclose(neighbour_difference(maps), plain)
    assert torch.autograd.gradcheck(neighbour_difference, maps)

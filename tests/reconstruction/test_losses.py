"""What the losses of Phase I prefer; nvdiffrec's image loss against loops written from its description."""

import math

import pytest
import torch

from lightprobe.core.config import DecomposeConfig, ImageLoss
from lightprobe.reconstruction.losses import (
    LATE_ROUGHNESS_PRIOR,
    ROUGHNESS_PRIOR,
    USUAL_ROUGHNESS,
    brightness_anchor,
    color_change,
    frame_loss,
    grey_world,
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
    usual = material(0.3, USUAL_ROUGHNESS, 0.0).detach()
    assert float(material_prior(usual, DecomposeConfig(), decided=False)) < 1e-9


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
    config = DecomposeConfig(metallic_prior=0.0)

    def cost(metallic: float, *, decided: bool) -> float:
        matte = material(0.3, USUAL_ROUGHNESS + 0.4, metallic).detach()
        return float(material_prior(matte, config, decided=decided)) / 0.4**2

    assert cost(0.0, decided=False) == cost(1.0, decided=False) == pytest.approx(ROUGHNESS_PRIOR)
    assert cost(0.0, decided=True) == pytest.approx(LATE_ROUGHNESS_PRIOR)
    assert cost(1.0, decided=True) == pytest.approx(ROUGHNESS_PRIOR)
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
    shared = float(metal_parsimony(two, rough, metal))
    assert shared == pytest.approx(math.log(2), rel=1e-3)  # halves that share nothing
    assert float(cost) > math.log(2)
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


def test_the_mean_base_colour_is_held_where_priors_are_wanted():
    mean, config = torch.tensor(0.2), DecomposeConfig()
    assert float(brightness_anchor(torch.tensor([[0.1, 0.2, 0.4], [0.3, 0.2, 0.0]]), mean, config)) < 1e-9
    assert float(brightness_anchor(torch.full((3, 3), 0.4), mean, config)) > 0.04
    assert float(brightness_anchor(torch.full((3, 3), 0.4), mean, DecomposeConfig(priors=False))) == 0


def test_a_red_cast_of_all_lights_is_moved_to_the_surface():
    base = torch.full((5, 3), 0.3, requires_grad=True)
    grey_world(base, torch.tensor([0.2, -0.1, -0.1])).backward()
    assert base.grad is not None
    red, green, blue = (-base.grad).sum(0)  # the step of descent
    assert red > 0
    assert green < 0
    assert blue < 0
    assert torch.isclose(red + green + blue, torch.tensor(0.0), atol=1e-6)  # brightness stays


def target_of(photo: torch.Tensor, alpha: torch.Tensor) -> Target:
    view = View.of(camera_at((3, 0, 0)), torch.device("cpu"))
    return Target("photo", view, photo, alpha, torch.zeros_like(photo, dtype=torch.bool))


def test_missing_coverage_costs_whatever_the_colour():
    photo, alpha = torch.full((4, 3), 0.3), torch.ones(4)
    target = target_of(photo, alpha)
    background = torch.tensor([0.3, 0.3, 0.3])  # the hole looks like the object
    full = image_loss(photo, alpha, target, background, 4.0)
    hole = torch.tensor([1.0, 1.0, 1.0, 0.0])
    assert float(full) < 1e-6
    assert float(image_loss(photo * hole[:, None], hole, target, background, 4.0)) > 0.9


def test_the_difference_of_neighbours_and_its_gradient():
    random = torch.Generator().manual_seed(0)
    maps = torch.rand(5, 7, 3, dtype=torch.float64, generator=random).requires_grad_()
    plain = (maps[:, 1:] - maps[:, :-1]).abs().mean() + (maps[1:] - maps[:-1]).abs().mean()
    assert torch.isclose(neighbour_difference(maps), plain)
    assert torch.autograd.gradcheck(neighbour_difference, maps)


def displayed(x: float) -> float:
    y = math.log(1 + x)
    return 12.92 * y if y <= 0.0031308 else 1.055 * y ** (1 / 2.4) - 0.055


@pytest.mark.parametrize("kind", [ImageLoss.LOG_L1, ImageLoss.L2])
def test_the_loss_is_the_loop_s(kind):
    random = torch.Generator().manual_seed(3)
    cover, alpha = torch.rand(2, 20, generator=random).unbind(0)
    render, photo = (2 * torch.rand(2, 20, 3, generator=random)).unbind(0)
    background = torch.rand(3, generator=random)
    expected = 0.0
    for k in range(20):
        for channel in range(3):
            ours = float(alpha[k] * (render[k, channel] + (1 - cover[k]) * background[channel]))
            theirs = float(alpha[k] * (photo[k, channel] + (1 - alpha[k]) * background[channel]))
            expected += (
                (ours - theirs) ** 2 if kind is ImageLoss.L2 else abs(displayed(ours) - displayed(theirs))
            )
    expected = expected / 60 + 0.5 * float((cover - alpha).square().sum()) / 20
    assert float(frame_loss(render, cover, target_of(photo, alpha), background, 0.5, kind)) == pytest.approx(
        expected, rel=1e-4
    )


def test_light_beyond_a_clipped_pixel_costs_as_it_does_there():
    one, white = torch.ones(4), torch.ones(4, 3)
    loss = frame_loss(2 * white, one, target_of(white, one), torch.zeros(3), 1.0, ImageLoss.LOG_L1)
    assert float(loss) == pytest.approx(displayed(2.0) - displayed(1.0), rel=1e-4)


def test_smoothness_comes_in_over_500_steps_and_counts_by_frame():
    here, there = torch.zeros(8, 3), torch.full((8, 3), 0.5)
    assert float(color_change(here, there, 0.25, 0)) == 0
    assert float(color_change(here, there, 0.25, 250)) == pytest.approx(0.5 * 0.25 * 0.5)
    assert float(color_change(here, there, 0.25, 9000)) == pytest.approx(0.25 * 0.5)

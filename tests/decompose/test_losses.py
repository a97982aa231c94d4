"""What the losses of Phase I prefer: clipped pixels, usual materials, grey lights."""

import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.decompose.losses import (
    USUAL_BASE,
    USUAL_ROUGHNESS,
    color_gauge,
    image_loss,
    material_prior,
    one_sided,
)


def material(base: float, roughness: float, metallic: float) -> torch.Tensor:
    return torch.tensor([[base, base, base, roughness, metallic]]).repeat(10, 1).requires_grad_()


def gradient(value: torch.Tensor) -> torch.Tensor:
    material_prior(value, DecomposeConfig()).backward()
    assert value.grad is not None
    return value.grad.sum(0)


def test_the_usual_dielectric_costs_nothing():
    assert float(material_prior(material(USUAL_BASE, USUAL_ROUGHNESS, 0.0).detach(), DecomposeConfig())) < 1e-9


def test_unusual_materials_are_pulled_back():
    bright = gradient(material(4 * USUAL_BASE, 0.1, 0.5))
    assert (bright[:3] > 0).all()  # darker
    assert bright[3] < 0  # rougher
    assert bright[4] > 0  # less metallic
    assert (gradient(material(0.25 * USUAL_BASE, 0.9, 0.0))[:3] < 0).all()


def test_a_red_cast_of_all_lights_is_moved_to_the_surface():
    base = torch.full((5, 3), 0.3, requires_grad=True)
    color_gauge(base, torch.tensor([0.2, -0.1, -0.1])).backward()
    assert base.grad is not None
    red, green, blue = (-base.grad).sum(0)  # the step of descent
    assert red > 0
    assert green < 0
    assert blue < 0
    assert torch.isclose(red + green + blue, torch.tensor(0.0), atol=1e-6)  # brightness stays


def test_clipped_pixels_only_bound_the_light_from_below():
    photo = torch.tensor([[1.0, 1.0, 1.0], [0.5, 0.5, 0.5]])
    alpha = torch.ones(2)
    brighter = torch.tensor([[7.0, 7.0, 7.0], [0.6, 0.6, 0.6]])
    assert torch.equal(one_sided(brighter, photo, alpha)[0], photo[0])
    assert torch.equal(one_sided(brighter, photo, alpha)[1], brighter[1])
    darker = 0.5 * photo
    assert torch.equal(one_sided(darker, photo, alpha), darker)


def test_missing_coverage_costs_whatever_the_colour():
    photo, alpha = torch.full((4, 3), 0.3), torch.ones(4)
    background = torch.tensor([0.3, 0.3, 0.3])  # the hole looks like the object
    full = image_loss(photo, alpha, photo, alpha, background, 4.0)
    hole = torch.tensor([1.0, 1.0, 1.0, 0.0])
    assert float(full) < 1e-6
    assert float(image_loss(photo * hole[:, None], hole, photo, alpha, background, 4.0)) > 0.9

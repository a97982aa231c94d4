"""The first pass's model: its colours stay valid and can be learnt, and a texture in the photos moves its
surface.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.start import start_from_hull
from lightprobe.render.surface import View
from lightprobe.scene.hull import Hull
from tests.shapes import camera_at

CPU = torch.device("cpu")


FROM_THE_START = DecomposeConfig(texture_gradient_from=0.0)


def ball_model(config=FROM_THE_START):
    axis = np.linspace(-1.15, 1.15, 16)
    ball = sum(a**2 for a in np.meshgrid(axis, axis, axis)) < 0.8
    hull = Hull(ball, ball.astype(np.float32), np.full(3, -1.15), np.full(3, 1.15))
    return LatticeModel(start_from_hull(hull, 8), config, CPU, 0)


@pytest.mark.parametrize("deeper", [-0.02, 0.02])
def test_a_texture_seen_too_high_or_too_deep_moves_the_surface(monkeypatch, deeper):
    """The slope of what the picture is off by, as the ball shrinks or grows, against the difference."""
    model, view = ball_model(), View.of(camera_at((3.0, 0.5, 1.0), size=48, focal=60), CPU)
    model.offset.requires_grad_(False)

    def striped(points):
        color = 0.5 + 0.3 * torch.sin(6 * points)
        return torch.cat([color, torch.full((len(points), 5), 0.4)], 1)

    monkeypatch.setattr(model.material, "forward", striped)
    start = model.distance.detach().clone()

    def shown(shift):
        with torch.no_grad():
            model.distance.copy_(start + shift)
        gbuffer = model.rasterise(view, 0, 0.0).gbuffer
        image = torch.zeros(48 * 48, 3)
        return image.index_copy(0, gbuffer.pixel, gbuffer.base_color)

    photo = shown(0.0).detach()
    common = torch.stack([shown(deeper + step).detach().sum(1) > 0 for step in (-0.004, 0, 0.004)]).all(0)
    common &= photo.sum(1) > 0

    def error(shift):
        return (shown(shift) - photo)[common].square().mean()

    difference = float(error(deeper + 0.004).detach() - error(deeper - 0.004).detach()) / 0.008
    error(deeper).backward()
    slope = float(model.distance.grad.sum())
    assert slope * deeper > 0
    assert slope == pytest.approx(difference, rel=0.1)


def test_what_a_material_costs_moves_no_surface():
    model, view = ball_model(), View.of(camera_at((3.0, 0.5, 1.0), size=48, focal=60), CPU)
    with torch.no_grad():
        model.material.field.table.normal_(generator=torch.Generator().manual_seed(0))
    seen = model.rasterise(view, 0, 1.0)
    model.config = replace(FROM_THE_START, sdf_regularisation=0.0)
    (with_distances,) = torch.autograd.grad(seen.regularisation, model.distance, retain_graph=True)
    (without,) = torch.autograd.grad(
        model.rasterise(view, 0, 1.0).regularisation,
        model.distance,
        allow_unused=True,
        materialize_grads=True,
    )
    assert with_distances.any()
    assert not without.any()


@pytest.mark.parametrize("in_doubt", [False, True], ids=["solid", "lid"])
def test_a_texture_moves_the_surface_from_when_it_is_asked_to_unless_a_lid_is_in_doubt(in_doubt):
    model, view = (
        ball_model(DecomposeConfig(texture_gradient_from=0.7)),
        View.of(camera_at((3.0, 0.5, 1.0), size=48, focal=60), CPU),
    )
    model.lid_in_doubt.fill_(in_doubt)
    with torch.no_grad():
        model.material.field.table.normal_(generator=torch.Generator().manual_seed(0))
    slopes = []
    for progress in (0.69, 0.7):
        color = model.rasterise(view, 0, progress).gbuffer.base_color.sum()
        slopes += torch.autograd.grad(color, model.distance, allow_unused=True, materialize_grads=True)
    assert not slopes[0].any()
    assert slopes[1].any() != in_doubt

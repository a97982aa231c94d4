"""The photo as a linear function of its light: it is the renderer, has its transpose, and gives the light back."""

from dataclasses import replace

import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.prefilter import cached
from lightprobe.render import transport
from lightprobe.render.split_sum import shade
from lightprobe.render.taps import DenseTaps, GatheredTaps, SparseTaps
from lightprobe.render.transport import Transport, solve_light
from lightprobe.render.visibility import PointVisibility, VertexVisibility
from tests.gbuffers import R, sky, sphere_gbuffer
from tests.render.dense import DenseTransport


@pytest.mark.parametrize("taps", [SparseTaps, DenseTaps, GatheredTaps])  # two of a CPU, one of a GPU
def test_transport_is_the_renderer_and_its_adjoint(taps, monkeypatch):
    monkeypatch.setattr(transport, "look_up", lambda *given, often: taps(*given))
    gbuffer, operator = sphere_gbuffer(200, metallic=0.4), cached(R)
    light = sky(R)
    linear = Transport(gbuffer, operator)
    rendered = shade(gbuffer, operator, operator.apply(light))
    assert torch.allclose(linear.apply(light), rendered, rtol=1e-4, atol=1e-5)
    other = torch.rand(200, 3, generator=torch.Generator().manual_seed(3))
    left = float((linear.apply(light) * other).double().sum())
    assert left == pytest.approx(float((light * linear.adjoint(other)).double().sum()), rel=1e-4)


@pytest.mark.parametrize("taps", [SparseTaps, DenseTaps, GatheredTaps])
@pytest.mark.parametrize("shadowed", [False, True])
def test_some_pixels_of_a_transport_are_a_transport_of_their_own(taps, shadowed, monkeypatch):
    monkeypatch.setattr(transport, "look_up", lambda *given, often: taps(*given))
    gbuffer, operator, light = sphere_gbuffer(60, metallic=0.4), cached(R), sky(R)
    if shadowed:
        random = torch.Generator().manual_seed(0)
        table = torch.randint(0, 256, (9, 384), generator=random, dtype=torch.uint8)
        seen = VertexVisibility(table, torch.rand(9, 3, generator=random))
        index, weight = torch.randint(0, 9, (60, 3), generator=random), torch.full((60, 3), 1 / 3)
        gbuffer = replace(gbuffer, visibility=PointVisibility(seen, index, weight))
    rows = torch.tensor([50, 3, 3, 17])
    whole = Transport(gbuffer, operator)
    white = whole.white
    part = whole.select(rows)
    assert torch.allclose(part.white, white[rows], rtol=1e-5, atol=1e-6)
    assert torch.allclose(part.apply(light), whole.apply(light)[rows], rtol=1e-5, atol=1e-6)
    given = torch.rand(4, 3, generator=torch.Generator().manual_seed(3))
    spread = torch.zeros(60, 3).index_add(0, rows, given)
    assert torch.allclose(part.adjoint(given), whole.adjoint(spread), rtol=1e-4, atol=1e-6)


def test_unseen_directions_go_to_the_prior():
    gbuffer, operator = sphere_gbuffer(2000, roughness=0.15, metallic=1.0), cached(R)
    facing = (gbuffer.normal[:, 0] > 0.9).nonzero()[:, 0]  # these mirror only what is before the object
    linear = Transport(gbuffer, operator, facing)
    count = len(facing)
    prior = torch.full((6, R, R, 3), 0.3)
    seen = linear.adjoint(torch.ones(count, 3)).mean(-1)
    clipped = torch.zeros(count, 3, dtype=torch.bool)
    solved = solve_light(linear, linear.apply(sky(R)), torch.ones(count), clipped, prior, 0.1, 20).light
    dark = seen < 1e-3 * seen.max()
    assert dark.float().mean() > 0.2
    assert (solved[dark] - 0.3).abs().max() < 0.03
    assert torch.isfinite(solved).all()


@pytest.mark.slow
def test_a_coloured_metal_cannot_imitate_paint_where_channels_hold_together():
    """Red paint with white highlights: a red metal needs a light of contrast in green and blue, little in red."""
    paint, operator = sphere_gbuffer(1500, roughness=0.2, metallic=0.0, base=(0.6, 0.02, 0.02)), cached(R)
    metal = replace(paint, metallic=torch.full_like(paint.metallic, 0.6))
    light = sky(R).mean(-1, keepdim=True).expand(6, R, R, 3).contiguous()
    photo = Transport(paint, operator).apply(light)
    errors = {}
    for chroma in (0.0, 1.0):
        for name, surface in (("paint", paint), ("metal", metal)):
            linear = Transport(surface, operator)
            start = torch.full_like(light, float(light.mean()))
            pixels = photo, torch.ones(1500), torch.zeros_like(photo, dtype=torch.bool)
            found = solve_light(linear, *pixels, start, 1e-3, 40, chroma=chroma)
            errors[name, chroma] = float((found.radiance - photo).abs().mean() / photo.mean())
    assert errors["paint", 1.0] < 1.1 * errors["paint", 0.0]  # a grey light loses nothing
    assert errors["metal", 1.0] > 2 * errors["metal", 0.0]
    assert errors["metal", 1.0] > 4 * errors["paint", 1.0]


class Case:
    """A small problem of `solve_light`, in float64, and its objective as the docstring has it."""

    def __init__(self, chroma: float, faint: float = 0.4):
        random = torch.Generator().manual_seed(7)
        self.transport, self.share, self.chroma = DenseTransport.random(60, 4), 0.05, chroma

        def draw(*shape: int) -> torch.Tensor:
            return torch.rand(*shape, generator=random, dtype=torch.float64)

        self.prior = draw(6, 4, 4, 3) * torch.tensor([0.9, 0.6, faint])
        self.start = 2 * draw(6, 4, 4, 3)
        truth = draw(6, 4, 4, 3) ** 4 * 6
        self.observed = self.transport.apply(truth) * (0.5 + draw(60, 3))
        self.weight = draw(60) * (torch.arange(60) % 5 > 0)
        self.clipped = self.observed > self.observed.quantile(0.7)

    def solved(self, iterations: int) -> torch.Tensor:
        photo, start = (self.observed, self.weight, self.clipped), self.transport.lit(self.start)
        pull = self.prior, self.share, iterations, start, self.chroma
        return solve_light(self.transport, *photo, *pull).light

    def objective(self, light: torch.Tensor) -> torch.Tensor:
        weight = (self.weight / self.weight.sum())[:, None]
        gain = (weight * self.transport.apply(torch.ones_like(self.prior)) ** 2).sum(0).mean()
        angle = (cubemap.exact_solid_angles(4) / (4 * torch.pi))[..., None]
        error = self.transport.apply(light) - self.observed
        error = torch.where(self.clipped & (error > 0), 0.0, error)
        mean = self.prior.mean((0, 1, 2))
        grey = mean.mean()
        floor = mean.clamp(min=0.05 * float(grey))
        relative, usual = light / floor, (self.start / floor).mean(-1, keepdim=True)
        cast = grey**2 * (relative - relative.mean(-1, keepdim=True)) ** 2 / (1 + usual)
        prices = self.share * (light - self.prior) ** 2 + self.chroma * cast
        return (weight * error**2).sum() + gain * (angle * prices).sum()

    def slope(self, light: torch.Tensor) -> torch.Tensor:
        light = light.clone().requires_grad_()
        return torch.autograd.grad(self.objective(light), light)[0]


@pytest.mark.parametrize(("chroma", "faint"), [(0.0, 0.4), (0.3, 0.4), (0.01, 0.01)])
def test_among_clipped_pixels_and_from_a_start_of_its_own_the_light_is_the_objective_s_minimum(chroma, faint):
    """In the end the slope vanishes where the light is free and is not negative where it is 0."""
    case = Case(chroma, faint)
    light = case.solved(100)
    slope, before = case.slope(light), case.slope(case.start).abs().max()
    rendered = case.transport.apply(light)
    assert (case.clipped & (rendered > case.observed)).any()
    assert (case.clipped & (rendered < case.observed)).any()
    free = light > 1e-4
    assert 0.3 * light.numel() < free.sum() < light.numel() - 5
    assert float(slope[free].abs().max()) < 1e-5 * float(before)
    assert float(slope[~free].min()) > -1e-5 * float(before)


@pytest.mark.parametrize("chroma", [0.0, 0.3])
def test_one_iteration_goes_to_the_lowest_point_on_its_way(chroma):
    case = Case(chroma)
    case.clipped[:] = False  # so that the objective is a parabola
    light = case.solved(1)
    way = light - case.start
    slope = case.slope(case.start)
    assert float((slope * way).sum()) < 0
    assert abs(float((case.slope(light) * way).sum())) < 1e-5 * abs(float((slope * way).sum()))


def test_a_solve_does_not_depend_on_exposure_or_on_the_sum_of_weights():
    case = Case(0.3)
    usual = case.solved(20)
    case.weight = case.weight / 9
    case.observed, case.prior, case.start = 50 * case.observed, 50 * case.prior, 50 * case.start
    torch.testing.assert_close(case.solved(20), 50 * usual, rtol=1e-4, atol=1e-4)


def test_pixels_of_no_weight_leave_the_light_as_it_was_but_for_what_is_negative():
    case = Case(0.3)
    case.weight = torch.zeros(60)
    case.start[2, 1, 1] = -1.0
    torch.testing.assert_close(case.solved(5), case.start.clamp(min=0))

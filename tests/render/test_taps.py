"""Look-ups in a light's levels: all ways are one linear map, and adjoint is its transpose."""

import pytest
import torch

from lightprobe.light.prefilter import cached
from lightprobe.render.split_sum import Shading
from lightprobe.render.taps import DenseTaps, GatheredTaps, SparseTaps, look_up
from tests.gbuffers import R, sky, sphere_gbuffer


def looked_up():
    """Return the look-ups of a glossy sphere's pixels, and the prefilter they look into."""
    operator = cached(R)
    return Shading.of(sphere_gbuffer(200, roughness=0.3), operator).taps, operator


@pytest.mark.parametrize("kind", [SparseTaps, DenseTaps])
def test_all_ways_look_up_the_same(kind):
    (lobes, blocks), (others, other_blocks) = (
        taps(*looked_up()).apply(sky(R)) for taps in (kind, GatheredTaps)
    )
    torch.testing.assert_close(lobes, others, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(blocks, other_blocks, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kind", [SparseTaps, DenseTaps, GatheredTaps])
def test_adjoint_is_the_transpose(kind):
    taps, light = kind(*looked_up()), sky(R)
    lobes, blocks = taps.apply(light)
    back = taps.adjoint(torch.ones_like(lobes), torch.ones_like(blocks))
    torch.testing.assert_close((back * light).sum(), lobes.sum() + blocks.sum(), rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize("kind", [SparseTaps, DenseTaps, GatheredTaps])
def test_some_rows_are_those_rows_of_all(kind):
    taps, light, rows = kind(*looked_up()), sky(R), torch.tensor([5, 0, 63])
    every = taps.apply(light)[0].unflatten(0, (-1, 200))
    torch.testing.assert_close(taps.select(rows).apply(light)[0].unflatten(0, (-1, 3)), every[:, rows])


def test_few_pixels_of_a_coarse_light_are_written_out_where_they_are_looked_up_often():
    taps, operator = looked_up()
    assert type(look_up(taps, operator, often=True)) is DenseTaps
    assert type(look_up(taps, operator, often=False)) is SparseTaps
    assert type(look_up(taps, cached(32), often=True)) is SparseTaps
    many = Shading.of(sphere_gbuffer(2000, roughness=0.3), operator).taps
    assert type(look_up(many, operator, often=True)) is SparseTaps
    elsewhere = [(index.to("meta"), weight.to("meta")) for index, weight in taps]
    assert type(look_up(elsewhere, operator, often=True)) is GatheredTaps

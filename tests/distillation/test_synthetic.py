"""Re-rendered training examples: lights that are known, photos that could be real, an asset that is a little wrong."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.device import generator
from lightprobe.distillation.draw import Draw
from lightprobe.distillation.synthetic import LightPool, erroneous, photograph, rerender
from lightprobe.light import cubemap, prefilter
from lightprobe.light.environment import Environment
from lightprobe.light.resize import rotate_light
from lightprobe.render.asset import rasterize_asset
from lightprobe.render.split_sum import shade
from tests.lit_sphere import CPU, glossy_sphere, patch_light
from tests.shapes import camera_at


@pytest.fixture(scope="module")
def gbuffer():
    return rasterize_asset(glossy_sphere(), camera_at((2.6, 1.4, 1.2), size=32, focal=42.0), CPU)


def draw(step=0):
    return Draw(generator(0, "test", step))


def centroid(light):
    excess = (light.mean(-1, keepdim=True) - 1.2 * light.mean()).clamp(min=0)
    return torch.nn.functional.normalize((excess * cubemap.directions(light.shape[1])).sum((0, 1, 2)), dim=0)


def test_a_turned_light_shines_from_where_it_was_turned_to():
    axis = torch.nn.functional.normalize(torch.tensor([1.0, 0.3, 0.4]), dim=0)
    # Reads from a quarter turn back.
    quarter = torch.tensor([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = rotate_light(patch_light(axis.tolist()), quarter, 16)
    assert float(centroid(turned) @ (quarter.T @ axis)) > 0.99


def test_the_pool_keeps_what_is_up_and_is_deterministic():
    above = patch_light((0.2, 0.1, 1.0))
    up = torch.tensor([0.0, 1.0, 0.0])
    pool = LightPool(up, [], [Environment(above)], 16, seed=1)
    lights = [pool.light(k) for k in range(30)]
    from_map = [
        light for k, light in enumerate(lights) if Draw(generator(1, "light-pool", k)).uniform(0, 1) < 0.5
    ]
    assert len(from_map) > 8
    assert all(float(centroid(light) @ up) > 0.9 for light in from_map)
    assert all(torch.equal(light, pool.light(k)) for k, light in enumerate(lights[:5]))
    assert all(light.isfinite().all() and float(light.min()) >= 0 for light in lights)


def test_photos_are_exposed_clipped_and_have_eight_bits(gbuffer):
    operator = prefilter.cached(16, CPU)
    radiance = 700 * shade(gbuffer, operator, operator.apply(patch_light((1.0, 0.3, 0.4), brightness=60.0)))
    color, exposure = photograph(radiance, draw())
    assert float(color.max()) == pytest.approx(1.0, abs=1e-6)
    assert 0.05 < float(color.mean()) < 0.7
    assert len(color.unique()) <= 256
    unclipped = color < 0.9
    torch.testing.assert_close(color[unclipped], (radiance * exposure)[unclipped], rtol=0.2, atol=0.02)


def test_errors_of_the_asset_are_small_smooth_and_differ(gbuffer):
    wrong = erroneous(gbuffer, draw())
    angle = torch.rad2deg(torch.arccos((wrong.normal * gbuffer.normal).sum(1).clamp(-1, 1)))
    assert 0.5 < float(angle.mean()) < 12
    ratio = (wrong.base_color / gbuffer.base_color).log()
    assert 0.01 < float(ratio.std()) < 0.6
    assert float(wrong.base_color.max()) <= 0.95
    assert not torch.equal(erroneous(gbuffer, draw(1)).normal, wrong.normal)


def test_the_example_s_light_explains_its_photo(gbuffer):
    light = patch_light((1.0, 0.3, 0.4))
    operator = prefilter.cached(16, CPU)
    for step in range(4):
        color, factor = rerender(gbuffer, light, draw(step))
        again = shade(gbuffer, operator, operator.apply(light * factor))
        dim = color.max(1).values < 0.9
        ratio = again[dim].mean(0) / color[dim].mean(0)
        assert float((ratio - 1).abs().max()) < 0.25


@pytest.mark.slow
def test_errors_and_photos_are_made_where_the_g_buffer_is(gbuffer, monkeypatch):
    """PyTorch's device without values stands in for a GPU: no operator takes operands here and there."""
    elsewhere = {
        name: value.to("meta") for name, value in vars(gbuffer).items() if isinstance(value, torch.Tensor)
    }
    wrong = erroneous(replace(gbuffer, **elsewhere), draw())
    assert {wrong.normal.device.type, wrong.roughness.device.type, wrong.base_color.device.type} == {"meta"}
    monkeypatch.setattr(torch.Tensor, "__float__", lambda self: 0.2)  # the exposure asks for a value
    color, _ = photograph(torch.rand(50, 3, device="meta"), draw())
    assert color.device.type == "meta"


@pytest.mark.slow
def test_a_pool_turns_and_mixes_its_lights_on_its_device(monkeypatch):
    monkeypatch.setattr(
        "lightprobe.distillation.generated_lights._mean_above", lambda d, radiance: radiance.mean(0)
    )
    pool = LightPool(
        torch.tensor([0.0, 0.0, 1.0]), [Environment(patch_light((0, 0, 1)))], [], 16, 1, torch.device("meta")
    )
    monkeypatch.setattr(
        "lightprobe.distillation.synthetic.rotate_light", lambda light, turn, resolution: light + turn.sum()
    )
    assert {pool.light(k).device.type for k in range(20)} == {"meta"}

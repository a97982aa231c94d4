import math

import pytest
import torch

from lightprobe.distillation import generated_lights
from lightprobe.distillation.generated_lights import Place, generated_light
from lightprobe.light import cubemap

ANGLE = cubemap.solid_angles(16)[..., None] / (4 * math.pi)


def mean(light):
    return (light * ANGLE).sum((0, 1, 2))


@pytest.mark.parametrize("place", list(Place))
def test_lights_are_finite_bright_enough_and_not_all_alike(place):
    lights = [generated_light(16, seed=3, step=k, place=place) for k in range(6)]
    for light in lights:
        assert light.shape == (6, 16, 16, 3)
        assert light.dtype == torch.float32
        assert light.isfinite().all()
        assert float(light.min()) >= 0
    logs = torch.stack([(light / mean(light).mean() + 0.02).log() for light in lights])
    assert float(logs.std(0).mean()) > 0.2
    assert all(not torch.equal(lights[0], other) for other in lights[1:])


def test_their_brightness_is_1_in_the_mean_and_spreads_as_exposures_do():
    """Mean radiance is exp(.5 n), n standard normal, but for white balance, tint and clipping."""
    logs = torch.stack([mean(generated_light(16, seed=3, step=k)).mean().log() for k in range(40)])
    assert abs(float(logs.mean())) < 3 * 0.5 / 40**0.5
    assert 0.35 < float(logs.std()) < 0.7


def test_equal_arguments_give_equal_bits_and_seeds_matter():
    first, again, other = (generated_light(16, seed=s, step=5) for s in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_suns_are_thousands_of_times_brighter_than_the_mean():
    brightest = max(float(generated_light(32, seed=0, step=k, place=Place.SUN).max()) for k in range(20))
    assert brightest > 1e3


@pytest.mark.parametrize("place", [Place.OVERCAST, Place.SUN])
@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.6, 0.0, -0.8)])
def test_light_comes_from_above(place, up):
    axis = torch.tensor(up)
    upper = cubemap.directions(16) @ axis > 0.3
    lower = cubemap.directions(16) @ axis < -0.3
    shares = []
    for k in range(12):
        light = generated_light(16, seed=7, step=k, up=axis, tumbled=0.0, place=place)
        shares.append(float(light[upper].mean() / light[lower].mean()))
    assert sorted(shares)[6] > 1.5


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.6, 0.0, -0.8)])
def test_a_light_is_turned_about_up(up):
    axis, quarter = torch.tensor(up), math.pi / 2
    for step in range(4):
        towards = []
        for turn in (0.0, quarter):
            light = generated_light(
                16, seed=7, step=step, up=axis, turn=turn, tumbled=0.0, place=Place.STUDIO
            )
            flow = (light.mean(-1, keepdim=True) * cubemap.directions(16) * ANGLE).sum((0, 1, 2))
            towards.append(flow - (flow @ axis) * axis)
        turned = torch.linalg.cross(axis, towards[0])  # anticlockwise as seen from above
        assert float((towards[1] - turned).norm()) < 0.05 * float(turned.norm()) + 0.01


def test_tumbled_lights_come_from_anywhere():
    axes = []
    for k in range(40):
        light = generated_light(16, seed=7, step=k, tumbled=1.0, place=Place.OVERCAST)
        axes.append(
            torch.nn.functional.normalize(
                (light.mean(-1, keepdim=True) * cubemap.directions(16)).sum((0, 1, 2)), dim=0
            )
        )
    assert float(torch.stack(axes).mean(0).norm()) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("place", list(Place))
def test_lights_are_made_on_the_device_they_are_wanted_on(place, monkeypatch):
    """PyTorch's device without values stands in for a GPU: no operator takes operands here and there."""
    monkeypatch.setattr(
        generated_lights, "_mean_above", lambda d, radiance: radiance.mean(0)
    )  # asks for values
    elsewhere = torch.device("meta")
    for step in range(8):
        light = generated_light(16, seed=3, step=step, place=place, device=elsewhere)
        assert light.device == elsewhere
        assert light.shape == (6, 16, 16, 3)

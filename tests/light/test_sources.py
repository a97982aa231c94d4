import math
from dataclasses import replace

import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.sources import LightSource, SplitLight, find_sources, split_light


def lamp(direction, radius: float = 6.0, irradiance=(3.0, 2.5, 2.0)) -> LightSource:
    x, y, z = torch.nn.functional.normalize(torch.tensor(direction, dtype=torch.float64), dim=0).tolist()
    return LightSource((x, y, z), math.radians(radius), irradiance)


def under(*lamps: LightSource, resolution: int = 32, sky: float = 0.3) -> Environment:
    """Lamps under a sky that is brighter on top."""
    height = cubemap.directions(resolution)[..., 2:]
    light = sky * (1 + 0.5 * height) * torch.tensor([0.8, 1.0, 1.2])
    return Environment(light + sum(source.texels(resolution) for source in lamps))


def degrees(a: LightSource, b: LightSource) -> float:
    cosine = sum(x * y for x, y in zip(a.direction, b.direction, strict=True))
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


@pytest.mark.parametrize("resolution", [16, 32, 128])
@pytest.mark.parametrize("direction", [(1, 0.2, 0.3), (0, 0, 1), (-0.577, 0.577, 0.577), (-0.3, 0.1, -0.9)])
def test_a_lamp_is_found_where_and_as_bright_as_it_is(direction, resolution):
    true = lamp(direction)
    (found,) = find_sources(under(true, resolution=resolution))
    assert degrees(found, true) < 0.5 * 90 / resolution
    assert found.irradiance == pytest.approx(true.irradiance, rel=0.15)
    off = math.radians(2.5 if resolution > 16 else 4)
    assert found.angular_radius == pytest.approx(true.angular_radius, abs=off)


def test_sources_come_strongest_first_and_no_more_than_are_asked_for():
    lamps = [
        lamp((1, 0, 0.2), irradiance=(1.0, 1.0, 1.0)),
        lamp((0, 1, 0.2), irradiance=(4.0, 3.0, 3.0)),
        lamp((-1, -1, 0.5), irradiance=(2.0, 2.0, 2.5)),
    ]
    found = find_sources(under(*lamps))
    assert [min(range(3), key=lambda k: degrees(lamps[k], source)) for source in found] == [1, 2, 0]
    assert all(min(degrees(true, source) for true in lamps) < 2 for source in found)
    assert len(find_sources(under(*lamps), 2)) == 2
    assert find_sources(under(*lamps)) == found


@pytest.mark.parametrize(
    "light",
    [
        torch.full((6, 16, 16, 3), 0.7),
        torch.zeros(6, 16, 16, 3),
        under().texels,
        torch.rand(6, 8, 8, 3, generator=torch.Generator().manual_seed(0)),
    ],
)
def test_a_light_without_sources_has_none(light):
    split = split_light(Environment(light))
    assert split.sources == ()
    assert torch.equal(split.rest.texels, light)


def test_nothing_is_lost_between_the_sources_and_the_rest():
    true = lamp((0.4, -0.8, 0.5))
    whole = under(true)
    split = split_light(whole)
    assert float(split.rest.texels.min()) >= 0
    assert float(split.rest.texels.max()) < 0.1 * float(whole.texels.max())
    taken = (whole.mean() - split.rest.mean()) * 4 * math.pi
    assert list(split.sources[0].irradiance) == pytest.approx(taken.tolist(), rel=0.06)


@pytest.mark.parametrize(("resolution", "radius"), [(8, 0.3), (32, 0.3), (8, 180)])
def test_a_source_as_texels_has_its_irradiance(resolution, radius):
    source = lamp((0.2, 0.5, 0.7), radius)
    cosine = (cubemap.directions(resolution) @ torch.tensor(source.direction)).clamp(min=0)
    weight = (cosine * cubemap.solid_angles(resolution))[..., None]
    received = (source.texels(resolution) * weight).sum((0, 1, 2))
    assert received.tolist() == pytest.approx(source.irradiance, rel=1e-4)


def test_the_form_in_json_is_in_degrees_and_says_none_of_what_is_not_known() -> None:
    source = LightSource((0.6, 0.0, 0.8), math.pi / 6, (1.0, 2.0, 3.0), 0.25, math.pi / 36)
    known = {"direction": [0.6, 0.0, 0.8], "irradiance_rgb": [1, 2, 3]}
    known["angular_radius_deg"] = pytest.approx(30)
    assert source.to_json() == known | {"uncertainty": 0.25, "direction_uncertainty_deg": pytest.approx(5)}
    plain = LightSource(source.direction, source.angular_radius, source.irradiance)
    assert plain.to_json() == known | {"uncertainty": None, "direction_uncertainty_deg": None}
    assert LightSource.from_json(plain.to_json()) == replace(plain, angular_radius=pytest.approx(math.pi / 6))
    again = LightSource.from_json(source.to_json())
    assert (again.uncertainty, again.direction_uncertainty) == (0.25, pytest.approx(math.pi / 36))


VALID = {"direction": [3, -4, 12], "angular_radius_deg": 2, "irradiance_rgb": [0.5, 0, 0]}


@pytest.mark.parametrize("length", [1.2e-6, 1, 9e5])
def test_a_direction_of_any_length_is_made_a_unit_vector(length: float) -> None:
    value = VALID | {"direction": [length * x / 13 for x in (3, -4, 12)]}
    source = LightSource.from_json(value)
    assert source.direction == pytest.approx((3 / 13, -4 / 13, 12 / 13))
    assert source.irradiance == (0.5, 0, 0)
    assert (source.uncertainty, source.direction_uncertainty) == (None, None)


@pytest.mark.parametrize(("degrees", "kept"), [(0, 0.265), (0.2, 0.265), (0.3, 0.3), (179, 179), (500, 180)])
def test_a_radius_is_at_least_the_sun_s_and_at_most_half_a_turn(degrees: float, kept: float) -> None:
    source = LightSource.from_json(VALID | {"angular_radius_deg": degrees})
    assert math.degrees(source.angular_radius) == pytest.approx(kept)


@pytest.mark.parametrize(
    "change",
    [
        {"direction": [1, 0]},
        {"direction": [0, 9e-7, 0]},
        {"direction": [0, 0, 1.2e6]},
        {"irradiance_rgb": [-0.1, 1, 1]},
        {"irradiance_rgb": [1, 1, -0.1]},
        {"irradiance_rgb": [1, math.inf, 1]},
        {"angular_radius_deg": math.nan},
        {"uncertainty": math.nan},
        {"direction_uncertainty_deg": math.inf},
    ],
)
def test_numbers_beyond_what_a_source_may_have_are_refused(change: dict) -> None:
    with pytest.raises(ValueError, match=r"no light source has such numbers|not enough values"):
        LightSource.from_json(VALID | change)


def test_a_factor_scales_each_channel_of_sources_and_rest() -> None:
    source, factor = lamp((0, 0, 1), irradiance=(1.0, 2.0, 3.0)), torch.tensor([2.0, 3.0, 0.5])
    split = SplitLight(Environment(torch.ones(6, 8, 8, 3)), (source,)).scaled(factor)
    assert split.sources == (replace(source, irradiance=(2.0, 6.0, 1.5)),)
    assert split.rest.texels[3, 1, 2].tolist() == [2, 3, 0.5]


@pytest.mark.parametrize(
    ("radius", "sharpness"), [(math.pi / 9, 4 / (math.pi / 9) ** 2), (0.01, 16**2 * 6 / math.pi)]
)
def test_a_source_is_a_spherical_gaussian_no_narrower_than_a_texel(radius: float, sharpness: float) -> None:
    towards = cubemap.directions(16)
    source = LightSource((0.0, -0.6, 0.8), radius, (1.0, 2.0, 4.0))
    seen, cosine = source.texels(16), towards @ torch.tensor(source.direction)
    torch.testing.assert_close(seen[..., 2], 4 * seen[..., 0])
    near = cosine > 0.9
    log = (seen[..., 1][near] / seen.max()).log()
    slope = (log - log.max()) / (cosine[near] - cosine.max()).clamp(max=-1e-9)
    assert float(slope[slope > 0].mean()) == pytest.approx(sharpness, rel=1e-3)

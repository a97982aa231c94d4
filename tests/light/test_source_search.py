"""Which texels are a source: how far it must stand out, what counts as its tail, what is left in its place."""

import math

import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.sources import LightSource, find_sources, split_light

FINE = cubemap.exact_directions(64)
PEAK = FINE[0, 31, 32]
AWAY = torch.rad2deg(torch.acos((FINE @ PEAK).clamp(-1, 1)))  # degrees from the texel's centre


def grey(radiance: torch.Tensor) -> Environment:
    return Environment(radiance.float()[..., None].expand(*radiance.shape, 3).contiguous())


def under_sky(level: float, *discs: tuple[float, float]) -> torch.Tensor:
    """Return discs of (degrees, radiance) around one texel, one on top of the other, under an even sky."""
    radiance = torch.full_like(AWAY, level)
    for degrees, value in discs:
        radiance[degrees > AWAY] = value
    radiance[0, 31, 32] += 0.001  # the peak
    return radiance


@pytest.mark.parametrize(("radiance", "count"), [(2.9, 0), (3.15, 1)])
def test_a_source_is_three_times_as_bright_as_its_surroundings(radiance: float, count: int) -> None:
    assert len(find_sources(grey(0.5 * under_sky(0.2, (50, 1.0), (12, radiance))))) == count


@pytest.mark.parametrize(("times_the_mean", "count"), [(2.9, 0), (3.1, 1)])
def test_a_source_is_three_times_as_bright_as_the_whole_light(times_the_mean: float, count: int) -> None:
    sky = under_sky(1.0, (60, 0.2))
    mean = 1 - 0.8 * (1 - math.cos(math.radians(60))) / 2  # of the sky
    share = (1 - math.cos(math.radians(12))) / 2
    radiance = times_the_mean * (mean - 0.2 * share) / (1 - times_the_mean * share)  # the mean includes it
    sky[AWAY < 12] = radiance
    assert len(find_sources(grey(sky))) == count


@pytest.mark.parametrize(("share", "count"), [(0.018, 0), (0.025, 1)])
def test_a_source_has_a_fiftieth_of_the_flux(share: float, count: int) -> None:
    light, angle = torch.ones(6, 16, 16), cubemap.exact_solid_angles(16)
    light[2, 5, 9] += share / (1 - share) * 4 * math.pi / float(angle[2, 5, 9])
    assert len(find_sources(grey(light))) == count


def test_the_level_in_a_source_s_place_is_the_median_of_a_ring_from_15_to_30_degrees() -> None:
    ramp = 0.1 * AWAY
    ramp[AWAY < 3] = 3000.0 - AWAY[AWAY < 3]
    split = split_light(grey(ramp))
    assert len(split.sources) == 1
    median = float(ramp[(AWAY > 15) & (AWAY < 30)].median())
    assert median == pytest.approx(2.42, abs=0.02)
    left = split.rest.texels[AWAY < 3].flatten().tolist()
    assert left == pytest.approx([median] * len(left), rel=1e-5)


@pytest.mark.parametrize(("halo", "core"), [(12.0, 9.0), (11.8, 3.0)])
def test_a_core_is_what_reaches_a_tenth_of_the_height_above_the_ring(halo: float, core: float) -> None:
    """The sky is 2, the lamp 101: from 11.9 on a halo is core, its tail 1.6 times as far and a texel."""
    rest = split_light(grey(under_sky(2.0, (9, halo), (3, 101.0)))).rest.texels[..., 0]
    texel = math.degrees(math.sqrt(float(cubemap.exact_solid_angles(64)[0, 31, 32])))
    end = 1.6 * float(AWAY[core > AWAY].max()) + texel
    assert torch.equal((rest < 2.01) & (AWAY < 9), (end > AWAY) & (AWAY < 9))


@pytest.mark.parametrize(("tail", "left"), [(3.2, 2.0), (2.8, 2.8)])
def test_a_tail_ends_at_one_and_a_half_times_the_ring_s_level(tail: float, left: float) -> None:
    rest = split_light(grey(under_sky(2.0, (5.5, tail), (3, 101.0)))).rest.texels[..., 0]
    ring = rest[(AWAY > 3.1) & (AWAY < 5.4)]
    assert sorted(set(ring.tolist())) == pytest.approx([left])


def test_a_source_reaches_25_degrees_from_its_peak_and_its_tail_1_6_times_as_far_and_a_texel() -> None:
    azimuth = torch.rad2deg(torch.atan2(FINE[..., 1], FINE[..., 0]))
    bar = (FINE[..., 2].abs() < math.sin(math.radians(2))) & (azimuth > 0) & (azimuth < 80)
    radiance = torch.where(bar, 100 - 0.1 * azimuth, 1.0)
    split = split_light(grey(radiance), most=1)
    peak = FINE[bar][azimuth[bar].argmin()]
    apart = torch.rad2deg(torch.acos((FINE[bar] @ peak).clamp(-1, 1)))
    texel = math.degrees(math.sqrt(float(cubemap.exact_solid_angles(64)[0, 31, 32])))
    end = 1.6 * float(apart[apart < 25].max()) + texel
    cut = split.rest.texels[..., 0][bar] < 2
    assert torch.equal(cut, apart < end)


def test_texels_belong_together_that_share_an_edge_or_a_corner() -> None:
    light = torch.ones(6, 32, 32)
    light[0, 15:17, 15:17] = 100.0
    light[0, 15, 15] = 120.0
    light[0, 17, 17] = 90.0  # beyond a corner
    light[0, 15, 13] = 80.0  # beyond a gap
    split = split_light(grey(light))
    left = split.rest.texels[0, ..., 0]
    assert len(split.sources) == 1
    assert float(left[15:18, 15:18].max()) == pytest.approx(1)
    assert float(left[15, 13]) == pytest.approx(80)
    assert int((left > 2).sum()) == 1


def test_a_square_of_four_texels_has_the_numbers_worked_out_by_hand() -> None:
    """Its blue is darker than the sky's: there is no negative light, and the rest keeps it."""
    light = torch.full((6, 16, 16, 3), 1.0)
    light[4, 7:9, 7:9] = torch.tensor([201.0, 101.0, 0.25])
    split = split_light(Environment(light))
    (source,) = split.sources
    apart = math.acos(1 / math.sqrt(1 + 2 / 16**2))
    angle = float(cubemap.exact_solid_angles(16)[4, 7, 7])
    assert source.direction == pytest.approx((0, 0, 1), abs=1e-9)
    assert source.angular_radius == pytest.approx(math.sqrt(2 * (apart**2 - angle / 6)), rel=1e-5)
    received = 4 * angle * math.cos(apart)
    assert source.irradiance == pytest.approx((200 * received, 100 * received, 0), rel=1e-5)
    assert split.rest.texels[4, 8, 7].tolist() == pytest.approx([1, 1, 0.25])


def test_a_direction_is_the_mean_by_flux() -> None:
    light = torch.ones(6, 16, 16)
    light[4, 8, 7:9] = torch.tensor([300.0, 100.0])
    light[4, 7, 8] = 50.0
    (source,) = find_sources(grey(light))
    towards, angle = cubemap.exact_directions(16), cubemap.exact_solid_angles(16)
    mean = ((light - 1) * angle)[..., None].mul(towards).sum((0, 1, 2))
    assert source.direction == pytest.approx((mean / mean.norm()).tolist(), abs=1e-6)


def test_a_single_texel_is_taken_for_as_small_as_the_sun() -> None:
    light = torch.ones(6, 16, 16)
    light[5, 3, 12] = 1000.0
    (source,) = find_sources(grey(light))
    assert math.degrees(source.angular_radius) == pytest.approx(0.265)
    assert source.direction == pytest.approx(cubemap.exact_directions(16)[5, 3, 12].tolist())


def ten_lamps() -> Environment:
    light = torch.ones(6, 16, 16)
    for k in range(10):
        light[k % 6, 3 + 9 * (k // 6), 4] = 400.0 + 10 * k
    light[0, 3:5, 4:6] = 200.0  # the dimmest, and the largest
    return grey(light)


def test_the_greatest_irradiance_comes_first_and_eight_are_the_most() -> None:
    found = find_sources(ten_lamps(), 10)
    assert len(found) == 10
    total = [sum(source.irradiance) for source in found]
    assert total == sorted(total, reverse=True)
    assert found[0].direction[0] > 0.5
    assert len(find_sources(ten_lamps())) == 8
    assert find_sources(ten_lamps(), 0) == ()


def test_what_lies_beside_a_source_within_two_texels_is_no_source_of_its_own() -> None:
    def sources(column: int) -> tuple[LightSource, ...]:
        light = torch.ones(6, 32, 32)
        light[4, 15, 10] = 800.0
        light[4, 15, column] = 500.0
        return find_sources(grey(light))

    assert [len(sources(column)) for column in (8, 7, 6)] == [1, 2, 2]

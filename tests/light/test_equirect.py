"""Equirectangular maps texel by texel: directions, solid angles, what lies between texels, and means both ways."""

import math

import numpy as np
import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.light import cubemap, equirect
from lightprobe.light.sources import LightSource


def test_directions_of_the_smallest_map_worked_out_by_hand() -> None:
    half, root = 0.5, math.sqrt(0.5)
    top = [[-half, half, root], [half, half, root], [half, -half, root], [-half, -half, root]]
    expected = torch.tensor([top, [[x, y, -z] for x, y, z in top]])
    found = equirect.directions(2)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, expected)


def test_solid_angles_are_bands_cut_into_equal_parts() -> None:
    found = equirect.solid_angles(3)
    assert (found.dtype, found.shape) == (torch.float32, (3, 6))
    assert found[:, 4].tolist() == pytest.approx([math.pi / 6, math.pi / 3, math.pi / 6])


MAP = torch.tensor([[1.0, 2.0, 4.0, 8.0], [16.0, 32.0, 64.0, 128.0]], dtype=torch.float64)[..., None]


@pytest.mark.parametrize(
    ("azimuth", "polar", "value"),
    [
        (135, 45, 1),
        (45, 45, 2),
        (-45, 45, 4),
        (-135, 45, 8),
        (45, 135, 32),
        (-135, 135, 128),
        (0, 45, 3),
        (90, 45, 1.5),
        (67.5, 45, 1.75),
        (180, 45, 4.5),
        (-180, 45, 4.5),
        (157.5, 135, 44),
        (-157.5, 135, 100),
        (45, 90, 17),
        (45, 67.5, 9.5),
        (45, 10, 4 + 1 / 3),
        (45, 44, 2 + 1 / 15),
        (45, 140, 37 + 1 / 3),
        (0, 0, 3.75),
        (0, 180, 60),
        (22.5, 90, 21.25),
    ],
)
def test_between_centres_a_map_is_bilinear_around_the_seam_and_across_the_poles(
    azimuth: float, polar: float, value: float
) -> None:
    phi, theta = math.radians(azimuth), math.radians(polar)
    x, y = math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi)
    direction = torch.tensor([[x, y, math.cos(theta)]]).double()
    found = equirect.sample(MAP, direction / direction.norm())
    assert found.dtype == torch.float64
    assert float(found) == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize(("height", "width"), [(3, 5), (4, 4), (2, 6)])
def test_a_map_that_is_not_twice_as_wide_as_high_is_one_sentence(height: int, width: int) -> None:
    with pytest.raises(InputError, match=f"twice as wide as high, not {width} x {height}: crop or resize"):
        equirect.to_cubemap(torch.ones(height, width, 3), 8)


@pytest.mark.parametrize("resolution", [1, 2])
def test_a_cubemap_s_texel_is_the_mean_of_the_map_over_its_solid_angle(resolution: int) -> None:
    """Of x, y and z^2, by the midpoint rule over 1 / (1 + a^2 + b^2)^1.5 on the face of each texel."""
    towards = equirect.directions(64).double()
    cube = equirect.to_cubemap(torch.cat([towards[..., :2], towards[..., 2:] ** 2], -1), resolution)
    inner = (np.arange(200) + 0.5) / 100 - 1
    b, a = np.meshgrid(inner, inner, indexing="ij")
    squared = 1 + a**2 + b**2
    weight = squared**-1.5
    size = 200 // resolution
    one = np.ones_like(a)
    points = ((one, -b, -a), (-one, -b, a), (a, one, b), (a, -one, -b), (a, -b, one), (-a, -b, -one))
    for face, (x, y, z) in enumerate(points):
        for channel, value in enumerate((x / squared**0.5, y / squared**0.5, z**2 / squared)):
            blocks = (resolution, size, resolution, size)
            mean = (value * weight).reshape(blocks).sum((1, 3)) / weight.reshape(blocks).sum((1, 3))
            assert cube[face, ..., channel].numpy() == pytest.approx(mean, abs=1e-3)


@pytest.mark.parametrize(("height", "resolution"), [(32, 2), (8, 16), (4, 1)])
def test_a_lamp_of_one_texel_keeps_its_flux_in_a_cubemap_of_any_size(height: int, resolution: int) -> None:
    for row, column in ((height // 2, 1), (height // 3, height), (height // 2 - 1, 2 * height - 1)):
        lamp = torch.zeros(height, 2 * height, 1)
        lamp[row, column] = 100.0
        cube = equirect.to_cubemap(lamp, resolution)[..., 0]
        received = float((cube * cubemap.solid_angles(resolution)).sum())
        flux = 100 * float(equirect.solid_angles(height)[row, column])
        assert received == pytest.approx(flux, rel=0.05 if height > 8 else 0.15)


@pytest.mark.parametrize(("resolution", "height"), [(32, 4), (16, 8), (4, 16)])
def test_a_coarser_map_is_a_mean_of_what_the_cubemap_has_there(resolution: int, height: int) -> None:
    for face, row, column in ((0, resolution // 2, resolution // 3), (2, resolution // 3, resolution // 2)):
        lamp = torch.zeros(6, resolution, resolution, 1)
        lamp[face, row, column] = 100.0
        map = equirect.from_cubemap(lamp, height)
        assert map.shape == (height, 2 * height, 1)
        flux = 100 * float(cubemap.solid_angles(resolution)[face, row, column])
        assert float((map[..., 0] * equirect.solid_angles(height)).sum()) == pytest.approx(flux, rel=0.1)


@pytest.mark.parametrize("elevation", [90, 87, 80])
def test_a_lamp_overhead_keeps_its_flux_in_a_map_and_back(elevation: int) -> None:
    towards = (math.cos(math.radians(elevation)), 0.0, math.sin(math.radians(elevation)))
    lamp = LightSource(towards, math.radians(3), (1.0, 1.0, 1.0)).texels(32)
    flux = float((lamp[..., 0] * cubemap.solid_angles(32)).sum())
    map = equirect.from_cubemap(lamp, 64)
    assert float((map[..., 0] * equirect.solid_angles(64)).sum()) == pytest.approx(flux, rel=0.025)
    again = equirect.to_cubemap(map, 32)
    assert float((again[..., 0] * cubemap.solid_angles(32)).sum()) == pytest.approx(flux, rel=0.065)


def test_a_map_of_a_cubemap_can_be_differentiated() -> None:
    cube = torch.rand(6, 2, 2, 3, generator=torch.Generator().manual_seed(0), requires_grad=True)
    (gradient,) = torch.autograd.grad(equirect.from_cubemap(cube, 4).sum(), cube)
    assert float(gradient.sum()) == pytest.approx(4 * 8 * 3, rel=1e-5)
    assert gradient.min() > 0


@pytest.mark.parametrize("resolution", [4, 16, 33])
def test_solid_angles_cover_the_sphere(resolution):
    assert float(cubemap.solid_angles(resolution).double().sum()) == pytest.approx(4 * math.pi, rel=1e-5)
    assert float(equirect.solid_angles(resolution).double().sum()) == pytest.approx(4 * math.pi, rel=1e-3)


def test_round_trip_keeps_six_colours_in_place():
    d = cubemap.directions(16)
    cube = torch.cat([d.clamp(min=0), (-d).clamp(min=0)], -1)
    there = equirect.from_cubemap(cube, 64)
    back = equirect.to_cubemap(there, 16)
    assert (back - cube).abs().max() < 0.06
    expected = equirect.directions(64)
    assert (there[..., :3] - expected.clamp(min=0)).abs().max() < 0.06

"""Sources fitted to a photo of a ball that casts its shadow on a floor, under a known lamp."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.optimize
import torch

from lightprobe.geometry.mesh import Mesh
from lightprobe.light import cubemap, prefilter
from lightprobe.light.environment import Environment
from lightprobe.light.sources import LightSource
from lightprobe.material.textures import Textures
from lightprobe.prediction.observation import Observation, observe
from lightprobe.prediction.source_fit import _non_negative, fitted_sources
from lightprobe.render.asset import Asset, textured_visibility
from lightprobe.render.picture import Picture
from lightprobe.scene.photo import Pixels
from tests.shapes import ball_over_floor, camera_at

CPU = torch.device("cpu")
R = 32
CAMERA = camera_at((1.6, -1.2, 1.4), size=96, focal=120.0)
TRUE = LightSource((0.48, 0.6, 0.64), math.radians(2.0), (3.0, 2.6, 2.0))


def sky() -> torch.Tensor:
    return (0.3 + 0.1 * cubemap.directions(R)[..., 2:]) * torch.tensor([0.8, 1.0, 1.2])


@pytest.fixture(scope="module")
def scene() -> tuple[Asset, Observation]:
    vertices, faces, _ = ball_over_floor(0.35, 0.6)
    uvs = torch.rand(len(vertices), 2, generator=torch.Generator().manual_seed(0))
    plain = torch.tensor([0.0, 0.0, 1.0]).expand(8, 8, 3).contiguous()
    textures = Textures(torch.full((8, 8, 3), 0.5), torch.full((8, 8), 0.7), torch.zeros(8, 8), plain)
    mesh = Mesh(vertices, faces, uvs, faces)
    asset = Asset(mesh, textures, textured_visibility(mesh, textures.flat()))
    return asset, photograph(asset, sky() + TRUE.texels(R))


def photograph(asset: Asset, light: torch.Tensor) -> Observation:
    image, cover = Picture.of(asset, CAMERA, prefilter.cached(R, CPU), CPU).render(light)
    color = np.where(cover[..., None] > 0.99, image.numpy(), 0)
    pixels = Pixels.of(color, (cover > 0.99).float().numpy())
    return observe(asset, pixels, CAMERA, CPU, 65_536)


def predicted(direction=TRUE.direction, irradiance=TRUE.irradiance, radius: float = 8.0) -> Environment:
    """A map with a blurred lamp."""
    unit = torch.nn.functional.normalize(torch.tensor(direction, dtype=torch.float64), dim=0)
    x, y, z = unit.tolist()
    return Environment(sky() + LightSource((x, y, z), math.radians(radius), irradiance).texels(R))


def degrees(a, b) -> float:
    return math.degrees(math.acos(min(1.0, sum(x * y for x, y in zip(a, b, strict=True)))))


@pytest.mark.slow
def test_the_photo_gives_a_dim_lamp_its_irradiance(scene):
    asset, observation = scene
    dim = predicted(irradiance=(1.2, 1.1, 0.8))
    (source,) = fitted_sources(observation, dim, asset.mesh, 0).sources
    assert source.irradiance == pytest.approx(TRUE.irradiance, rel=0.15)
    assert degrees(source.direction, TRUE.direction) < 3
    assert 0 < source.uncertainty < 0.8


def test_a_lamp_beside_its_place_is_moved_by_its_shadow(scene):
    asset, observation = scene
    wrong = (0.464, 0.735, 0.4944)
    beside = predicted(direction=wrong)
    (source,) = fitted_sources(observation, beside, asset.mesh, 0).sources
    assert degrees(wrong, TRUE.direction) > 8
    assert degrees(source.direction, TRUE.direction) < 4


def test_a_lamp_that_is_not_there_is_left_out(scene):
    asset, _ = scene
    phantom = predicted(irradiance=(1.0, 1.0, 1.0))
    assert fitted_sources(photograph(asset, sky()), phantom, asset.mesh, 0).sources == ()


def test_the_strongest_after_the_fit_comes_first(scene):
    asset, observation = scene
    phantom = LightSource((0.0, -0.8, 0.6), math.radians(8), (2.0, 2.0, 2.0))
    map_ = Environment(predicted(irradiance=(1.2, 1.1, 0.8)).texels + phantom.texels(R))
    first, *others = fitted_sources(observation, map_, asset.mesh, 0).sources
    assert degrees(first.direction, TRUE.direction) < 5
    assert all(sum(other.irradiance) < sum(first.irradiance) for other in others)


@pytest.mark.slow
def test_the_same_call_gives_the_same_bits_and_scales_with_exposure(scene):
    asset, observation = scene
    dim = predicted(irradiance=(1.5, 1.4, 1.0))
    first, again = (fitted_sources(observation, dim, asset.mesh, 0).sources for _ in range(2))
    assert first == again
    pixels = dataclasses.replace(observation.pixels, color=4 * observation.pixels.color)
    brighter = dataclasses.replace(observation, pixels=pixels, light_level=4 * observation.light_level)
    (scaled,) = fitted_sources(brighter, dim.scaled(4.0), asset.mesh, 0).sources
    assert scaled.irradiance == pytest.approx([4 * e for e in first[0].irradiance], rel=1e-3)


def test_clipped_pixels_hold_a_source_up_and_never_down(scene):
    asset, observation = scene
    white = 0.5 * float(observation.pixels.color.max())
    color = observation.pixels.color.clamp(max=white)
    clipped = dataclasses.replace(
        observation, pixels=dataclasses.replace(observation.pixels, color=color), clipped=color >= white
    )
    (source,) = fitted_sources(clipped, predicted(irradiance=(1.2, 1.1, 0.8)), asset.mesh, 0).sources
    assert float(clipped.clipped.float().mean()) > 0.1
    assert source.irradiance[0] > 1.6


def test_a_map_without_sources_stays_as_it_is(scene):
    asset, observation = scene
    split = fitted_sources(observation, Environment(sky()), asset.mesh, 0)
    assert split.sources == ()
    assert torch.equal(split.rest.texels, sky())


@pytest.mark.parametrize("count", [1, 3, 9, 20])
def test_non_negative_minima_are_scipys(count):
    random = np.random.default_rng(count)
    held = 0
    for _ in range(20):
        matrix, observed = (
            random.uniform(size=(30, count)) ** 4 + 1,
            random.uniform(size=30),
        )  # alike, as images are
        found = _non_negative(
            torch.from_numpy(matrix.T @ matrix), torch.from_numpy(matrix.T @ observed)
        ).numpy()
        np.testing.assert_allclose(found, scipy.optimize.nnls(matrix, observed)[0], atol=1e-9)
        held += int((found == 0).sum())
    assert (held > 0) == (count > 1)
    assert not _non_negative(torch.eye(count), -torch.ones(count)).any()

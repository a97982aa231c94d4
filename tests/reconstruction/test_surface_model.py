"""The second pass's model: starts as the asset it is given, holds its shape together and its texels valid."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig, VertexUnit
from lightprobe.light.prefilter import MIN_ROUGHNESS
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.render.asset import rasterize_asset, textured_visibility
from lightprobe.render.surface import View
from tests.lit_sphere import CORNER, CPU, glossy_sphere

CONFIG = DecomposeConfig(shadows=False)
SHAPE = replace(  # nothing costs but what bends the shape
    CONFIG,
    smoothness_texture=0.0,
    normal_prior=0.0,
    metallic_prior=0.0,
    priors=False,
)


def cost(model, progress=0.0):
    return float(model.rasterise(View.of(CORNER, CPU), 0, progress).regularisation.detach())


def random_like(value, size=1.0):
    return size * torch.randn(value.shape, generator=torch.Generator().manual_seed(0))


def test_it_starts_as_the_asset():
    asset = glossy_sphere()
    model = SurfaceModel(asset, CONFIG)
    expected = rasterize_asset(asset, CORNER, CPU)
    for found in (
        model.rasterise(View.of(CORNER, CPU), 0, 0.0).gbuffer,
        next(model.gbuffers([View.of(CORNER, CPU)], 0.0)),
    ):
        for name in ("pixel", "normal", "base_color", "roughness", "metallic"):
            torch.testing.assert_close(getattr(found, name), getattr(expected, name), rtol=1e-5, atol=1e-6)
    again = model.asset()
    assert torch.equal(again.mesh.vertices, asset.mesh.vertices)
    torch.testing.assert_close(again.textures.flat(), asset.textures.flat())


@pytest.mark.parametrize("unit", list(VertexUnit))
def test_displacements_are_in_their_unit(unit):
    asset = glossy_sphere()
    model = SurfaceModel(asset, replace(CONFIG, vertex_unit=unit))
    edges = (
        asset.mesh.vertices[model.edges.vertices[:, 0]] - asset.mesh.vertices[model.edges.vertices[:, 1]]
    ).norm(dim=1)
    size = float(edges.mean()) if unit is VertexUnit.EDGE else 1.0
    with torch.no_grad():
        model.displacement[5, 2] = 3.0
    moved = model.mesh().vertices.detach() - asset.mesh.vertices
    assert float(moved[5, 2]) == pytest.approx(3 * size, rel=1e-4)
    assert int(moved.count_nonzero()) == 1


def test_a_move_of_the_whole_costs_nothing_and_a_spike_what_its_laplacian_says():
    model = SurfaceModel(glossy_sphere(), SHAPE)
    with torch.no_grad():
        model.displacement += torch.tensor([0.1, -0.05, 0.02])
        assert cost(model) == pytest.approx(0, abs=1e-10)
        model.displacement[7] += torch.tensor([0.3, 0.0, 0.4])
    neighbours = model.edges.vertices[(model.edges.vertices == 7).any(1)].flatten()
    neighbours = neighbours[neighbours != 7]
    degree = torch.bincount(model.edges.vertices.flatten()).float()
    expected = 0.5 * 0.25 * (1 + float((1 / degree[neighbours]).square().sum())) / len(degree)
    assert cost(model) == pytest.approx(expected, rel=1e-4)


def test_the_laplacian_fades_where_it_is_told_to():
    for fades, later in ((False, 1.0), (True, 0.25)):
        model = SurfaceModel(glossy_sphere(), replace(SHAPE, laplacian_fades=fades))
        with torch.no_grad():
            model.displacement += random_like(model.displacement, 0.1)
        assert cost(model, 0.75) == pytest.approx(later * cost(model, 0.0), rel=1e-4)


def test_texels_are_brought_back_into_their_ranges():
    model = SurfaceModel(glossy_sphere(), CONFIG)
    with torch.no_grad():
        model.color += random_like(model.color)
        model.finish += random_like(model.finish)
    model.project()
    texels = model.texels().detach()
    assert 0 <= float(texels[:, :3].min()) <= float(texels[:, :3].max()) <= 1
    assert float(texels[:, 3].min()) == pytest.approx(MIN_ROUGHNESS)
    assert 0 <= float(texels[:, 4].min()) <= float(texels[:, 4].max()) <= 1
    torch.testing.assert_close(model.asset().textures.normal.norm(dim=-1), torch.ones(128, 128))


@pytest.mark.slow
def test_brightening_multiplies_colours_their_mean_and_what_is_seen_of_them():
    asset = glossy_sphere()
    asset = replace(asset, visibility=textured_visibility(asset.mesh, asset.textures.flat()))
    model = SurfaceModel(asset, CONFIG)
    mean = float(model.mean_color)
    model.brighten(0.5)
    torch.testing.assert_close(model.color.detach(), 0.5 * asset.textures.flat()[:, :3])
    assert float(model.mean_color) == pytest.approx(0.5 * mean)
    torch.testing.assert_close(model.visibility.occluder_color, 0.5 * asset.visibility.occluder_color)


@pytest.mark.slow
def test_shadows_are_found_anew_once_something_moved():
    asset = glossy_sphere()
    asset = replace(asset, visibility=textured_visibility(asset.mesh, asset.textures.flat()))
    model = SurfaceModel(asset, replace(CONFIG, shadows=True))
    model.update_visibility()
    assert model.visibility is asset.visibility
    with torch.no_grad():
        model.displacement[asset.mesh.vertices[:, 2] > 0.5] += torch.tensor([0.0, 0.0, -8.0])  # folded in
    model.update_visibility()
    assert not torch.equal(model.visibility.unoccluded, asset.visibility.unoccluded)

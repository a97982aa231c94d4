"""The textured object: kept in a file as it is, refused when damaged, and shaded with its normal map."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.checkpoint import save_tensors
from lightprobe.core.errors import InputError
from lightprobe.geometry.mesh import uv_tangents
from lightprobe.render.asset import (
    Asset,
    asset_gbuffer,
    rasterize_asset,
    shading_normals,
    textured_visibility,
    uv_handedness,
)
from lightprobe.render.surface import View, visible_surface
from tests.lit_sphere import CORNER, CPU, glossy_sphere


def shown(asset):
    view = View.of(CORNER, CPU)
    return visible_surface(asset.mesh.vertices, asset.mesh.faces, view), view


@pytest.mark.parametrize("shadows", [False, True])
def test_a_file_gives_the_asset_back(tmp_path, shadows):
    asset = glossy_sphere()
    if shadows:
        asset = replace(asset, visibility=textured_visibility(asset.mesh, asset.textures.flat()))
    asset.save(tmp_path / "asset.safetensors")
    again = Asset.load(tmp_path / "asset.safetensors")
    assert again.tensors().keys() == asset.tensors().keys()
    for name, value in asset.tensors().items():
        assert torch.equal(again.tensors()[name], value), name


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("faces", lambda faces: faces + 100_000, "faces"),
        ("vertices", lambda vertices: vertices * torch.nan, "vertices"),
        ("roughness", lambda roughness: roughness[:-1], "roughness"),
        ("base_color", lambda color: color + 2, "base_color"),
        ("normal_faces", lambda faces: faces + 100_000, "more normals than there are corners"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, name, change, words):
    tensors = glossy_sphere().tensors()
    tensors.setdefault("normal_faces", tensors["faces"])
    tensors[name] = change(tensors[name]).contiguous()
    save_tensors(tmp_path / "asset.safetensors", tensors)
    with pytest.raises(InputError, match=words):
        Asset.load(tmp_path / "asset.safetensors")


def test_an_even_normal_map_leaves_the_interpolated_normals():
    asset = glossy_sphere()
    surface, _ = shown(asset)
    even = torch.tensor([0.0, 0, 1]).expand(len(surface.pixel), 3)
    normals = shading_normals(surface, asset.mesh, asset.mesh.normals(), uv_tangents(asset.mesh), even)
    facing = (surface.position * surface.view).sum(1) > 0.1
    assert (normals - torch.nn.functional.normalize(surface.position, dim=1))[facing].abs().max() < 0.02


def test_the_normal_map_bends_towards_growing_u_and_falling_v():
    """As glTF has it: x along +u, y along -v, as v points down."""
    asset = glossy_sphere()
    mesh, (surface, _) = asset.mesh, shown(asset)
    even = torch.tensor([0.0, 0, 1]).expand(len(surface.pixel), 3)
    tangents = uv_tangents(mesh)
    straight = shading_normals(surface, mesh, mesh.normals(), tangents, even)
    corners, uv = mesh.vertices[mesh.faces[surface.face].long()], mesh.uvs[mesh.uv_faces[surface.face].long()]
    edges, along = corners[:, 1:] - corners[:, :1], uv[:, 1:] - uv[:, :1]  # what a step in u and v is in space
    u, v = torch.nn.functional.normalize(torch.linalg.solve(along, edges), dim=2).unbind(1)
    v = v - (u * v).sum(1, keepdim=True) * u  # charts are sheared, and the frame is not
    facing = (straight * surface.view).sum(1) > 0.5
    for axis, towards in ((0, u), (1, -v)):
        mapped = even.clone()
        mapped[:, axis] = 0.2
        bent = shading_normals(surface, mesh, mesh.normals(), tangents, mapped) - straight
        agreement = torch.nn.functional.cosine_similarity(bent, towards, dim=1)
        assert float(agreement[facing].min()) > 0.95


def test_handedness_turns_with_the_chart():
    mesh = glossy_sphere().mesh
    mirrored = replace(mesh, uvs=mesh.uvs * torch.tensor([-1.0, 1.0]) + torch.tensor([1.0, 0.0]))
    assert torch.equal(uv_handedness(mirrored), -uv_handedness(mesh))


def test_a_gbuffer_shows_the_textures_where_the_surface_is():
    asset = glossy_sphere()
    gbuffer, (surface, view) = rasterize_asset(asset, CORNER, CPU), shown(asset)
    again = asset_gbuffer(asset, surface, view)
    uv = surface.interpolate(asset.mesh.uvs, asset.mesh.uv_faces) * asset.textures.size
    nearest = asset.textures.base_color[uv[:, 1].long(), uv[:, 0].long()]
    assert (gbuffer.base_color - nearest).abs().mean() < 0.02
    for name in ("pixel", "normal", "base_color", "roughness", "metallic"):
        assert torch.equal(getattr(gbuffer, name), getattr(again, name))

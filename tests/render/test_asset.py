"""The textured object: kept in a file as it is, refused when damaged, and shaded with its normal map."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from lightprobe.core.checkpoint import save_tensors
from lightprobe.core.errors import InputError
from lightprobe.geometry.mesh import Mesh, uv_tangents
from lightprobe.geometry.textures import Textures
from lightprobe.render.asset import (
    Asset,
    asset_gbuffer,
    mapped_normals,
    rasterize_asset,
    shading_normals,
    textured_gbuffer,
    textured_visibility,
    uv_handedness,
)
from lightprobe.render.surface import Surface, View, visible_surface
from lightprobe.render.visibility import VertexVisibility
from tests.lit_sphere import CORNER, CPU, glossy_sphere


def shown(asset):
    view = View.of(CORNER, CPU)
    return visible_surface(asset.mesh.vertices, asset.mesh.faces, view), view


@pytest.mark.slow
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


def test_a_gbuffer_shows_the_textures_where_the_surface_is():
    asset = glossy_sphere()
    gbuffer, (surface, view) = rasterize_asset(asset, CORNER, CPU), shown(asset)
    again = asset_gbuffer(asset, surface, view)
    uv = surface.interpolate(asset.mesh.uvs, asset.mesh.uv_faces) * asset.textures.size
    nearest = asset.textures.base_color[uv[:, 1].long(), uv[:, 0].long()]
    assert (gbuffer.base_color - nearest).abs().mean() < 0.02
    for name in ("pixel", "normal", "base_color", "roughness", "metallic"):
        assert torch.equal(getattr(gbuffer, name), getattr(again, name))


UVS = torch.tensor([[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]])  # v points down, so that the triangle's y is -v
FACES = torch.tensor([[0, 1, 2]], dtype=torch.int32)


def triangle(uvs: torch.Tensor = UVS) -> Mesh:
    """Return a triangle in the plane z = 0 that looks up, on a chart of the whole texture."""
    return Mesh(torch.tensor([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]]), FACES, uvs, FACES)


def small(size: int = 2) -> dict[str, torch.Tensor]:
    """Return the tensors of a triangle that casts shadows and has a few texels."""
    up = torch.tensor([0.0, 0.0, 1.0]).expand(size, size, 3).contiguous()
    half = torch.full((size, size), 0.5)
    textures = Textures(half[..., None].expand(size, size, 3).contiguous(), half, half.clone(), up)
    seen = VertexVisibility(torch.full((3, 384), 255, dtype=torch.uint8), torch.full((3, 3), 0.5))
    tensors = Asset(replace(triangle(), normal_faces=FACES.clone()), textures, seen).tensors()
    return {name: value.clone() for name, value in tensors.items()}


@pytest.mark.parametrize(
    ("name", "low", "high", "step"),
    [
        ("vertices", -1000.0, 1000.0, 1.0),
        ("uvs", -0.00099, 1.00099, 1e-4),
        ("base_color", -0.00099, 1.00099, 1e-4),
        ("roughness", -0.00099, 1.00099, 1e-4),
        ("metallic", -0.00099, 1.00099, 1e-4),
        ("normal", -1.00099, 1.00099, 1e-4),
        ("blockers", -0.00099, 1.00099, 1e-4),
        ("faces", 0, 2, 1),
        ("uv_faces", 0, 2, 1),
        ("normal_faces", 0, 2, 1),
    ],
)
def test_values_are_taken_up_to_their_bounds_and_refused_beyond(name, low, high, step):
    for value, fits in ((low, True), (high, True), (low - step, False), (high + step, False)):
        tensors = small()
        tensors[name].view(-1)[1] = value
        if fits:
            asset = Asset.from_tensors(tensors, Path("x"), "make it again")
            assert torch.equal(asset.tensors()[name], tensors[name])
        else:
            with pytest.raises(InputError, match=r"x is damaged .*; make it again\."):
                Asset.from_tensors(tensors, Path("x"), "make it again")


def test_a_texture_has_at_least_two_texels_along_an_edge():
    assert Asset.from_tensors(small(2), Path("x"), "again").textures.size == 2
    with pytest.raises(InputError, match="its textures have a single texel; again"):
        Asset.from_tensors(small(1), Path("x"), "again")


def test_visibility_is_that_of_the_vertices_or_left_out():
    whole = small()
    for name in ("openness", "blockers"):
        with pytest.raises(InputError, match=name):
            Asset.from_tensors(whole | {name: whole[name][:2].contiguous()}, Path("x"), "again")
    del whole["blockers"]
    with pytest.raises(InputError, match="has no 'blockers'"):
        Asset.from_tensors(whole, Path("x"), "again")
    del whole["openness"]
    assert Asset.from_tensors(whole, Path("x"), "again").visibility is None


def test_an_asset_moves_with_all_its_parts():
    asset = Asset.from_tensors(small(), Path("x"), "again").to(torch.device("meta"))
    assert {value.device.type for value in asset.tensors().values()} == {"meta"}
    assert len(asset.tensors()) == 11


@pytest.mark.parametrize(
    ("uvs", "sign"),
    [
        (UVS, 1.0),
        (UVS * torch.tensor([-1.0, 1.0]) + torch.tensor([1.0, 0.0]), -1.0),
        (torch.zeros(3, 2), 1.0),
    ],
)
def test_handedness_tells_where_the_bitangent_lies(uvs, sign):
    mesh = triangle(uvs)
    assert uv_handedness(mesh).tolist() == [sign]
    two = replace(mesh, uv_faces=torch.tensor([[0, 1, 2], [0, 2, 1]], dtype=torch.int32))
    assert uv_handedness(two, torch.tensor([1, 0, 0])).tolist() == [-sign if uvs.any() else sign, sign, sign]


def one_point(view: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Surface:
    """Return a visible point a fifth of the way to the second corner of the triangle and half to the third."""
    zero, weights = torch.zeros(1, dtype=torch.long), torch.tensor([[0.3, 0.2, 0.5]])
    return Surface(zero, zero, weights, torch.tensor([[0.4, 0.5, 0.0]]), torch.tensor([view]))


def test_a_mapped_normal_by_hand():
    mapped = torch.tensor([[0.3, 0.4, 0.75**0.5]])
    mirrored = UVS * torch.tensor([-1.0, 1.0]) + torch.tensor([1.0, 0.0])
    for uvs, along in ((UVS, 1.0), (mirrored, -1.0)):
        mesh = triangle(uvs)
        tangents = uv_tangents(mesh)
        straight = mapped_normals(one_point(), mesh, mesh.normals(), tangents, mapped)
        torch.testing.assert_close(straight, torch.tensor([[along * 0.3, 0.4, 0.75**0.5]]))
        tilted = torch.tensor([[0.6, 0.0, 0.8]]).expand(3, 3)
        # The frame is x: (.8, 0, -.6), turned round with the chart, y: (0, 1, 0), z: (.6, 0, .8).
        expected = torch.tensor([[0.24 * along + 0.6 * 0.75**0.5, 0.4, -0.18 * along + 0.8 * 0.75**0.5]])
        torch.testing.assert_close(mapped_normals(one_point(), mesh, tilted, tangents, mapped), expected)
        longer = mapped_normals(one_point(), mesh, 5 * tilted, 3 * tangents, 7 * mapped)
        torch.testing.assert_close(longer, expected)


def test_normals_and_tangents_are_those_of_the_corners_by_their_weights():
    mesh = triangle()
    normals = torch.tensor([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    up = torch.tensor([[0.0, 0, 1]])
    found = mapped_normals(one_point(), mesh, normals, uv_tangents(mesh), up)
    mean = torch.tensor([[0.2, 0.5, 0.3]])
    torch.testing.assert_close(found, mean / mean.norm())
    split = replace(mesh, normal_faces=torch.tensor([[2, 0, 1]], dtype=torch.int32))
    mean = torch.tensor([[0.5, 0.3, 0.2]])
    found = mapped_normals(one_point(), split, normals, uv_tangents(mesh), up)
    torch.testing.assert_close(found, mean / mean.norm())


def test_shading_normals_are_bent_until_they_are_seen():
    mesh, mapped = triangle(), torch.tensor([[0.6, 0.0, 0.8]])
    found = shading_normals(one_point((-1.0, 0, 0)), mesh, mesh.normals(), uv_tangents(mesh), mapped)
    expected = torch.tensor([[-0.02, 0.0, 0.8]])
    torch.testing.assert_close(found, expected / expected.norm())


def test_a_gbuffer_has_each_channel_of_the_textures_in_its_place():
    mesh = triangle()
    view = View.of(CORNER, CPU)
    channels = torch.tensor([0.1, 0.2, 0.3, 0.4, 0.6, 0.0, 0.28, 0.96]).expand(4, 8)
    gbuffer = textured_gbuffer(one_point(), view, mesh, channels, uv_tangents(mesh))
    assert (gbuffer.height, gbuffer.width) == (view.height, view.width)
    assert gbuffer.base_color[0].tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert gbuffer.normal[0].tolist() == pytest.approx([0.0, 0.28, 0.96])
    assert gbuffer.position[0].tolist() == pytest.approx([0.4, 0.5, 0.0])
    assert (float(gbuffer.roughness), float(gbuffer.metallic)) == pytest.approx((0.4, 0.6))
    assert gbuffer.visibility is None
    table = torch.tensor([0, 100, 200], dtype=torch.uint8)[:, None].expand(3, 384).contiguous()
    seen = VertexVisibility(table, torch.eye(3))
    point = textured_gbuffer(one_point(), view, mesh, channels, uv_tangents(mesh), seen).visibility
    assert point is not None
    assert point.occluder_color()[0].tolist() == pytest.approx([0.3, 0.2, 0.5])
    assert float(point.towards(torch.tensor([[0.0, 0, 1]]))) == pytest.approx(120 / 255)


def test_what_blocks_has_the_colour_of_the_texture_at_the_middle_of_its_face():
    """A small triangle under the middle of a large one, whose texture is of another colour in each half."""
    large = torch.tensor([[-1.0, -1, 0.5], [-1, 1, 0.5], [2, 0, 0.5]])
    below = torch.tensor([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.0, 0.1, 0.0]])
    faces = torch.tensor([[0, 1, 2], [3, 4, 5]], dtype=torch.int32)
    uvs = torch.tensor([[0.9, 0.1], [0.9, 0.9], [0.6, 0.5], [0.1, 0.1], [0.2, 0.1], [0.1, 0.2]])
    red, blue = torch.tensor([0.8, 0.2, 0.1]), torch.tensor([0.1, 0.3, 0.9])
    flat = torch.rand(64, 8, generator=torch.Generator().manual_seed(0))
    flat[:, :3] = torch.where((torch.arange(64) % 8 < 4)[:, None], red, blue)
    seen = textured_visibility(Mesh(torch.cat([large, below]), faces, uvs, faces), flat)
    torch.testing.assert_close(seen.occluder_color[3:], blue.expand(3, 3), rtol=0, atol=1e-4)

"""Shadows of suns in pictures, against where geometry puts them."""

import pytest
import torch

from lightprobe.geometry.mesh import Mesh
from lightprobe.light import cubemap, prefilter
from lightprobe.material.textures import Textures
from lightprobe.render.asset import Asset, rasterize_asset, textured_visibility
from lightprobe.render.picture import Picture
from lightprobe.render.suns import Suns, sharpened
from tests.shapes import ball_over_floor, camera_at, sphere_mesh

CPU = torch.device("cpu")
R = 16
SUN = int(cubemap.nearest_texel(torch.tensor([[0.5, 0.1, 0.9]], dtype=torch.float64), R))
TOWARDS = cubemap.directions(R).reshape(-1, 3)[SUN]


def sunny() -> torch.Tensor:
    """Return a light (6, R, R, 3) of .2 with a sun in one texel."""
    light = torch.full((6 * R * R, 3), 0.2)
    light[SUN] = torch.tensor([300.0, 270.0, 180.0])
    return light.reshape(6, R, R, 3)


def white(vertices, faces) -> Asset:
    """Return a mesh of one matte colour with its shadows."""
    mesh = Mesh(vertices, faces, torch.rand(len(vertices), 2, generator=torch.Generator().manual_seed(0)), faces)
    plain = torch.tensor([0.0, 0.0, 1.0]).expand(8, 8, 3).contiguous()
    textures = Textures(torch.full((8, 8, 3), 0.5), torch.ones(8, 8), torch.zeros(8, 8), plain)
    return Asset(mesh, textures, textured_visibility(mesh, textures.flat()))


def test_a_sun_is_found_where_it_stands():
    suns = Suns.of(sunny())
    assert len(suns.block) == 1
    torch.testing.assert_close(suns.direction[0], TOWARDS, atol=1e-6, rtol=0)
    flux = sunny().reshape(-1, 3)[SUN] * cubemap.solid_angles(R).reshape(-1)[SUN]
    torch.testing.assert_close(suns.flux[0], flux, rtol=5e-3, atol=0)
    assert int(cubemap.nearest_texel(TOWARDS[None].double(), 8)) == int(suns.block[0])


@pytest.mark.parametrize("light", [torch.full((6, R, R, 3), 0.5), torch.zeros(6, R, R, 3), torch.rand(6, 8, 8, 3)])
def test_a_light_without_any(light):
    assert len(Suns.of(light).block) == 0


def test_a_ball_is_lit_as_by_a_lamp_far_away():
    mesh = sphere_mesh(3)
    asset = white(mesh.vertices, mesh.faces)
    gbuffer = rasterize_asset(asset, camera_at((3.0, 1.0, 2.0), size=48, focal=66.0), CPU)
    suns = Suns.of(sunny())
    blocks = torch.zeros(384, 3)
    blocks[suns.block] = suns.flux / cubemap.solid_angles(8).reshape(-1, 1)[suns.block]
    diffuse = gbuffer.visibility.light(blocks, gbuffer.normal)[:, :3] + sharpened(gbuffer, asset.mesh, suns)
    expected = (gbuffer.normal @ TOWARDS).clamp(min=0)[:, None] * suns.flux[0] / torch.pi
    off = (diffuse - expected).abs().sum(1) / (suns.flux.sum() / torch.pi)
    assert float((off > 0.01).float().mean()) < 0.05  # along the edge of its shadow faces are lit or not
    assert float(off.max()) < 0.2


def test_the_shadow_of_a_ball_is_where_and_as_sharp_as_it_should():
    vertices, faces, _ = ball_over_floor(0.2, 0.5)
    asset, camera = white(vertices, faces), camera_at((0.01, 0.0, 4.0), size=200, focal=500.0)
    image, _ = Picture.of(asset, camera, prefilter.cached(R, CPU), CPU).render(sunny())
    gbuffer = rasterize_asset(asset, camera, CPU)
    brightness = image.reshape(-1, 3)[gbuffer.pixel].sum(1)
    # A floor point is in the shadow when its ray to the sun passes the ball's middle at less than the radius.
    away = torch.tensor([0.0, 0.0, 0.5]) - gbuffer.position
    distance = (away - (away @ TOWARDS)[:, None] * TOWARDS).norm(dim=1)
    floor = (gbuffer.position[:, 2] < 1e-3) & (gbuffer.position.abs().amax(1) < 0.65)
    lit, dark = (brightness[floor & part].median() for part in (distance > 0.3, distance < 0.15))
    assert float(dark) < 0.5 * float(lit)
    shadow = brightness < (lit + dark) / 2
    edge = 0.012  # radii: half a pixel of the picture and of the depth map, and the ball's facets
    wrong = floor & ((shadow & (distance > 0.2 + edge)) | (~shadow & (distance < 0.2 - edge)))
    assert int((floor & shadow).sum()) > 500
    assert int(wrong.sum()) < 0.02 * int((floor & shadow).sum())

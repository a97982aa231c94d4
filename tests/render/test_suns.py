"""Shadows of suns in pictures, against where geometry puts them."""

import math
from dataclasses import replace

import pytest
import torch

from lightprobe.geometry.mesh import Mesh
from lightprobe.geometry.textures import Textures
from lightprobe.light import cubemap, prefilter
from lightprobe.render import suns as suns_module
from lightprobe.render.asset import Asset, rasterize_asset, textured_visibility
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.picture import Picture
from lightprobe.render.suns import Suns, sharpened
from lightprobe.render.visibility import PointVisibility, VertexVisibility
from tests.shapes import ball_over_floor, camera_at

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
    uvs = torch.rand(len(vertices), 2, generator=torch.Generator().manual_seed(0))
    mesh = Mesh(vertices, faces, uvs, faces)
    plain = torch.tensor([0.0, 0.0, 1.0]).expand(8, 8, 3).contiguous()
    textures = Textures(torch.full((8, 8, 3), 0.5), torch.ones(8, 8), torch.zeros(8, 8), plain)
    return Asset(mesh, textures, textured_visibility(mesh, textures.flat()))


def test_a_light_without_any():
    for light in (torch.full((6, R, R, 3), 0.5), torch.zeros(6, R, R, 3), torch.rand(6, 8, 8, 3)):
        assert len(Suns.of(light).block) == 0


@pytest.mark.slow
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


def lit_texels(level: float, *suns: tuple[tuple[int, int, int], float]) -> torch.Tensor:
    """Return a grey light (6, R, R, 3) with suns of a brightness in a red (1.5, 1, .5) at (face, row, column)."""
    light = torch.full((6, R, R, 3), level)
    for place, brightness in suns:
        light[place] = brightness * torch.tensor([1.5, 1.0, 0.5])
    return light


def test_of_a_sun_counts_what_exceeds_three_times_its_block_s_median():
    suns = Suns.of(lit_texels(0.2, ((3, 5, 12), 2.4), ((3, 5, 13), 0.6)))
    assert suns.block.tolist() == [3 * 64 + 2 * 8 + 6]  # eight rows and columns of blocks on a face
    angle = cubemap.solid_angles(R)[3, 5, 12]
    torch.testing.assert_close(suns.flux[0], 0.75 * 2.4 * torch.tensor([1.5, 1.0, 0.5]) * angle)
    torch.testing.assert_close(suns.direction[0], cubemap.directions(R)[3, 5, 12])


def test_a_sun_of_two_texels_stands_where_its_flux_balances():
    suns = Suns.of(lit_texels(0.2, ((1, 8, 3), 6.6), ((1, 9, 2), 3.6)))
    assert suns.block.tolist() == [64 + 4 * 8 + 1]
    places = (1, torch.tensor([8, 9]), torch.tensor([3, 2]))
    strength = torch.tensor([6.0, 3.0])[:, None] * torch.tensor([1.5, 1.0, 0.5])
    flux = strength * cubemap.solid_angles(R)[places][:, None]
    torch.testing.assert_close(suns.flux[0], flux.sum(0))
    middle = (flux.sum(1, keepdim=True) * cubemap.directions(R)[places]).sum(0)
    torch.testing.assert_close(suns.direction[0], middle / middle.norm())


@pytest.mark.parametrize(("share", "count"), [(0.0049, 0), (0.0051, 1)])
def test_a_sun_has_more_than_half_a_hundredth_of_the_whole_flux(share, count):
    place = (4, 7, 9)
    angle = float(cubemap.solid_angles(R)[place])
    # (b - 3) angle = share (4 pi + (b - 1) angle), solved for the brightness b beside a light of 1
    brightness = (3 * angle + share * (4 * math.pi - angle)) / ((1 - share) * angle)
    assert len(Suns.of(lit_texels(1.0, (place, brightness))).block) == count


def test_the_eight_strongest_suns_come_in_their_order():
    angle = cubemap.solid_angles(R)
    places = [(face, 4 * k + 1, 3) for face in (0, 2, 5) for k in range(3)]
    strength = [30.0, 90.0, 50.0, 70.0, 20.0, 80.0, 10.0, 60.0, 40.0]
    suns = [(place, s / float(angle[place])) for place, s in zip(places, strength, strict=True)]
    light = lit_texels(0.1, *suns)
    order = sorted(range(9), key=lambda k: -strength[k])[:8]
    expected = [places[k][0] * 64 + places[k][1] // 2 * 8 + 1 for k in order]
    assert Suns.of(light).block.tolist() == expected


def test_texels_of_finer_lights_belong_to_larger_blocks():
    light = torch.full((6, 32, 32, 3), 0.1)
    light[2, 21, 6] = 500.0
    light[5, 3, 31] = 400.0
    assert Suns.of(light).block.tolist() == [2 * 64 + 5 * 8 + 1, 5 * 64 + 7]


def open_floor(count: int) -> tuple[GBuffer, Mesh]:
    """Return points in a row on a small floor which nothing hides, as their visibility has it."""
    corners = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]], dtype=torch.int32)
    mesh = Mesh(corners, faces, corners[:, :2].abs(), faces)
    seen = VertexVisibility(torch.full((4, 384), 255, dtype=torch.uint8), torch.zeros(4, 3))
    x = torch.linspace(-0.8, 0.8, count)
    up = torch.tensor([0.0, 0.0, 1.0]).expand(count, 3)
    ids, grey = torch.arange(count), torch.full((count,), 0.5)
    index, weight = torch.zeros(count, 1, dtype=torch.long), torch.ones(count, 1)
    position, base, points = torch.stack([x, 0 * x, 0 * x], 1), grey[:, None].expand(-1, 3), (ids, ids * 0)
    visibility = PointVisibility(seen, index, weight)
    return GBuffer(1, count, *points, position, up, up, base, grey, grey, visibility), mesh


def test_what_else_casts_shadows_is_looked_at_from_its_own_middle(monkeypatch):
    """A small sheet far from the object's middle hides the sun from one point of a floor and from no other."""
    monkeypatch.setattr(suns_module, "SIDE", 64)
    gbuffer, mesh = open_floor(9)
    towards = torch.nn.functional.normalize(torch.tensor([0.3, 0.2, 0.9]), dim=0)
    flux = torch.tensor([2.0, 1.0, 0.5])
    suns = Suns(towards[None], flux[None], cubemap.nearest_texel(towards[None].double(), 8))
    hidden = 6
    middle = gbuffer.position[hidden] + 20 * towards
    sheet = middle + 0.07 * torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    blocks = torch.zeros(384, 3)
    blocks[suns.block] = flux / cubemap.solid_angles(8).reshape(-1, 1)[suns.block]
    known = gbuffer.visibility.light(blocks, gbuffer.normal)[:, :3]
    full = flux * towards[2] / torch.pi
    for others, dark in (((), []), (((sheet, mesh.faces),), [hidden])):
        lit = torch.ones(9, 1)
        lit[dark] = 0
        found = known + sharpened(gbuffer, mesh, suns, others)
        torch.testing.assert_close(found, lit * full, rtol=1e-4, atol=1e-5)
    below = replace(suns, direction=-suns.direction)
    torch.testing.assert_close(known + sharpened(gbuffer, mesh, below), torch.zeros(9, 3), rtol=0, atol=1e-6)

"""Path-traced pictures: conventions, energy and normal maps against the project's own renderer."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.errors import ConfigError
from lightprobe.geometry.textures import Textures
from lightprobe.light import prefilter
from lightprobe.render import brdf, path_tracer
from lightprobe.render.asset import Asset
from lightprobe.render.path_tracer import PathTracer, check_path_tracer, environment_rows, tamed
from lightprobe.render.picture import Picture
from lightprobe.scene.camera import Camera
from tests.lit_sphere import CPU, glossy_sphere, patch_light
from tests.shapes import camera_at

CAMERA = replace(camera_at((2.4, 1.9, 1.3), size=48, focal=60.0), height=40, cx=27.0, cy=17.5, fy=66.0)


@pytest.fixture(scope="module")
def tracer_works():
    try:
        check_path_tracer()
    except ConfigError as missing:
        pytest.skip(str(missing))


def bumpy(asset: Asset) -> Asset:
    """The asset with smooth random bumps in its normal map."""
    random = torch.Generator().manual_seed(5)
    coarse = 0.2 * torch.randn(1, 2, 12, 12, generator=random)
    bumps = torch.nn.functional.interpolate(coarse, (128, 128), mode="bicubic")
    normal = torch.cat([bumps[0], torch.ones(1, 128, 128)]).permute(1, 2, 0)
    textures = asset.textures
    normal = torch.nn.functional.normalize(normal, dim=2)
    return Asset(asset.mesh, Textures(textures.base_color, textures.roughness, textures.metallic, normal))


def differences(asset: Asset, other: Asset | None = None) -> float:
    """Relative RMS difference of the path-traced picture and our own renderer's, where the object covers all."""
    light = patch_light((1.0, 0.3, 0.4))
    traced, cover = PathTracer(asset, 256).render(CAMERA, light)
    ours, _ = Picture.of(other or asset, CAMERA, prefilter.cached(16, CPU), CPU).render(light)
    inside = cover > 0.999
    return float((traced - ours)[inside].square().mean().sqrt() / ours[inside].square().mean().sqrt())


@pytest.mark.slow
@pytest.mark.usefixtures("tracer_works")
def test_a_convex_object_is_that_of_our_renderer():
    assert differences(glossy_sphere()) < 0.08


@pytest.mark.slow
@pytest.mark.usefixtures("tracer_works")
def test_a_normal_map_bends_as_in_our_renderer():
    bent = bumpy(glossy_sphere())
    assert differences(bent) < 0.12
    assert differences(bent, glossy_sphere()) > 0.25


@pytest.mark.usefixtures("tracer_works")
def test_under_a_constant_light_a_pixel_has_the_reflectance_of_its_integrals():
    rough, base = 0.4, 0.6
    flat, up = torch.full((8, 8), rough), torch.tensor([0.0, 0.0, 1.0]).expand(8, 8, 3)
    grey = Textures(torch.full((8, 8, 3), base), flat, torch.ones(8, 8), up)
    camera = camera_at((3.0, 0.0, 0.0), size=9, focal=120.0)  # its middle looks straight at the surface
    tracer, light = PathTracer(Asset(glossy_sphere().mesh, grey), 1024), torch.full((6, 8, 8, 3), 2.0)
    image, cover = tracer.render(camera, light)
    a, b, _ = brdf.environment_brdf(torch.tensor([1.0]), torch.tensor([rough]))
    assert float(cover.min()) == 1.0
    assert image[4, 4].numpy() == pytest.approx(2.0 * float(base * a + b), rel=0.02)


@pytest.mark.usefixtures("tracer_works")
def test_an_object_beside_the_picture_leaves_it_empty():
    beside = replace(CAMERA, cx=CAMERA.cx + 1000)
    image, cover = PathTracer(glossy_sphere(), 4).render(beside, patch_light((1.0, 0.3, 0.4)))
    assert image.shape == (40, 48, 3)
    assert float(image.abs().max()) == float(cover.max()) == 0


@pytest.mark.usefixtures("tracer_works")
def test_equal_seeds_give_equal_pictures_and_others_other_noise():
    light = patch_light((1.0, 0.3, 0.4))
    tracers = (PathTracer(glossy_sphere(), 4, seed) for seed in (1, 1, 2))
    first, again, other = (tracer.render(CAMERA, light)[0] for tracer in tracers)
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


@pytest.mark.long
@pytest.mark.usefixtures("tracer_works")
def test_a_picture_made_in_parts_has_every_pixel(monkeypatch):
    light = patch_light((1.0, 0.3, 0.4))
    whole, cover = PathTracer(glossy_sphere(), 64).render(CAMERA, light)
    monkeypatch.setattr(path_tracer, "_RAYS", 300)
    parts, again = PathTracer(glossy_sphere(), 64).render(CAMERA, light)
    assert float((cover - again).abs().mean()) < 0.01
    assert parts.mean((0, 1)).numpy() == pytest.approx(whole.mean((0, 1)).numpy(), rel=0.02)


def test_rows_of_an_environment_are_its_texels_and_their_midpoints():
    rows = environment_rows(np.arange(3.0)[:, None, None] * np.ones((3, 6, 3)))
    assert rows[:, 0, 0].tolist() == [0.0, 0.0, 0.5, 1.0, 1.5, 2.0, 2.0]


def test_without_its_libraries_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setattr(path_tracer, "_finds_llvm", lambda: False)
    with pytest.raises(ConfigError, match="LLVM library newer than 15"):
        PathTracer(glossy_sphere())
    monkeypatch.setitem(__import__("sys").modules, "mitsuba", None)
    with pytest.raises(ConfigError, match=r"pip install 'lightprobe\[path\]'"):
        PathTracer(glossy_sphere())


@pytest.mark.usefixtures("tracer_works")
def test_another_light_makes_another_picture_and_the_same_one_the_same():
    tracer, light = PathTracer(glossy_sphere(), 8), 1000 * patch_light((1.0, 0.3, 0.4))
    camera = camera_at((3.0, 0.0, 0.0), size=9, focal=60.0)
    first, _ = tracer.render(camera, light)
    twice, _ = tracer.render(camera, 2 * light)
    torch.testing.assert_close(twice, 2 * first, rtol=1e-3, atol=1e-2)
    other, _ = tracer.render(camera, light.flip(-1).contiguous())
    assert float((other[..., 2] / first[..., 0]).mean()) > 0.4
    assert not torch.allclose(other, first, rtol=0.1)
    assert torch.equal(tracer.render(camera, light)[0], first)


def test_rays_go_through_random_points_of_their_pixels():
    camera, pixel = replace(CAMERA, width=11, cx=4.0), np.repeat(np.arange(11 * 40), 200)
    direction = path_tracer._directions(camera, pixel, np.random.default_rng(0))
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1)
    place = camera.project(camera.position + 2.5 * direction)
    assert (place[:, 2] > 0).all()
    within = place[:, :2] - np.stack([pixel % 11, pixel // 11], axis=1)
    for axis in (0, 1):
        shares = np.histogram(within[:, axis], 10, (0, 1))[0] / len(pixel)
        assert shares.tolist() == pytest.approx([0.1] * 10, abs=0.01)
    assert abs(np.corrcoef(within.T)[0, 1]) < 0.01


@pytest.mark.parametrize(
    ("points", "columns", "rows"),
    [
        ([(2.3, 1.7, 2.0), (6.2, 4.1, 5.0)], range(2, 7), range(1, 5)),
        ([(2.0, 1.0, 2.0), (6.0, 4.0, 5.0)], range(2, 6), range(1, 4)),
        ([(-3.0, 1.7, 2.0), (1.5, 99.0, 5.0)], range(2), range(1, 8)),
        ([(7.5, -99.0, 2.0), (99.0, 0.5, 5.0)], range(7, 10), range(1)),
        ([(-3.0, 1.7, 2.0), (-1.5, 2.0, 5.0)], range(0), range(0)),
        ([(2.3, 1.7, 2.0), (6.2, 4.1, -5.0)], range(10), range(8)),
    ],
)
def test_pixels_are_those_of_the_rectangle_around_the_object(points, columns, rows):
    """All of them where a part of it is behind the camera. Points: x and y in the picture, and depth."""
    camera = Camera(np.eye(4), 10.0, 20.0, 4.0, 3.0, 10, 8)  # looks along -z, x to the right and y up
    x, y, depth = np.array(points).T
    vertices = np.stack([(x - 4) / 10 * depth, (3 - y) / 20 * depth, -depth], axis=1)
    expected = [10 * row + column for row in rows for column in columns]
    assert path_tracer._framed(vertices, camera).tolist() == expected


def test_a_tamed_ray_keeps_its_colour_and_coverage_is_left_alone():
    renders = np.array([[1.0, 0.5, 0.25, 1.0]] * 3 + [[100.0, 50.0, 10.0, 0.0]])
    assert tamed(renders) == pytest.approx([6.02 / 4, 3.01 / 4, (0.75 + 0.302) / 4, 0.75])
    for brightness, kept in ((3.01, 3.01), (3.05, 3.02)):
        renders[3] = brightness, 0.0, 0.0, 1.0
        assert tamed(renders)[0] == pytest.approx((3 + kept) / 4)
    assert tamed(np.zeros((4, 5, 4))).tolist() == [[0.0] * 4] * 5

"""Path-traced pictures: conventions, energy and normal maps against the project's own renderer."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.errors import ConfigError
from lightprobe.light import prefilter
from lightprobe.material.textures import Textures
from lightprobe.render import brdf, path_tracer
from lightprobe.render.asset import Asset
from lightprobe.render.path_tracer import PathTracer, check_path_tracer, environment_rows, tamed
from lightprobe.render.picture import Picture
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
    bumps = torch.nn.functional.interpolate(
        0.2 * torch.randn(1, 2, 12, 12, generator=random), (128, 128), mode="bicubic"
    )
    normal = torch.cat([bumps[0], torch.ones(1, 128, 128)]).permute(1, 2, 0)
    textures = asset.textures
    normal = torch.nn.functional.normalize(normal, dim=2)
    return Asset(asset.mesh, Textures(textures.base_color, textures.roughness, textures.metallic, normal))


def differences(asset: Asset, other: Asset | None = None) -> float:
    """Relative RMS difference of the path-traced picture and that of our own renderer, where the object covers all."""
    light = patch_light((1.0, 0.3, 0.4))
    traced, cover = PathTracer(asset, 256).render(CAMERA, light)
    ours, _ = Picture.of(other or asset, CAMERA, prefilter.cached(16, CPU), CPU).render(light)
    inside = cover > 0.999
    return float((traced - ours)[inside].square().mean().sqrt() / ours[inside].square().mean().sqrt())


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
    image, cover = PathTracer(Asset(glossy_sphere().mesh, grey), 1024).render(camera, torch.full((6, 8, 8, 3), 2.0))
    a, b = brdf.environment_brdf(torch.tensor([1.0]), torch.tensor([rough]))
    assert float(cover.min()) == 1.0
    assert image[4, 4].numpy() == pytest.approx(2.0 * float(base * a + b), rel=0.02)


@pytest.mark.usefixtures("tracer_works")
def test_coverage_is_that_of_our_renderer_and_outside_is_nothing():
    light = patch_light((1.0, 0.3, 0.4))
    image, cover = PathTracer(glossy_sphere(), 64).render(CAMERA, light)
    _, ours = Picture.of(glossy_sphere(), CAMERA, prefilter.cached(16, CPU), CPU).render(light)
    assert float((cover - ours).abs().max()) < 0.4
    assert float((cover - ours).abs().mean()) < 0.01
    assert bool((image[cover == 0] == 0).all())


@pytest.mark.usefixtures("tracer_works")
def test_equal_seeds_give_equal_pictures_and_others_other_noise():
    light = patch_light((1.0, 0.3, 0.4))
    first, again, other = (PathTracer(glossy_sphere(), 4, seed).render(CAMERA, light)[0] for seed in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


@pytest.mark.usefixtures("tracer_works")
def test_a_picture_made_in_parts_has_every_pixel(monkeypatch):
    light = patch_light((1.0, 0.3, 0.4))
    whole, cover = PathTracer(glossy_sphere(), 64).render(CAMERA, light)
    monkeypatch.setattr(path_tracer, "_RAYS", 300)
    parts, again = PathTracer(glossy_sphere(), 64).render(CAMERA, light)
    assert float((cover - again).abs().mean()) < 0.01
    assert parts.mean((0, 1)).numpy() == pytest.approx(whole.mean((0, 1)).numpy(), rel=0.02)


def test_one_lucky_ray_is_tamed_and_others_are_not():
    renders = np.full((4, 2, 4), 1.0)
    renders[2, 0, :3] = 400.0
    mean = tamed(renders)
    assert mean[0] == pytest.approx([1.505, 1.505, 1.505, 1.0])
    assert mean[1] == pytest.approx([1.0] * 4)


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

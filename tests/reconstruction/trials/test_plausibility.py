"""How plausible lights are: whether they know where the camera stands, and are as bright as backgrounds."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.imaging import write_png
from lightprobe.light.prefilter import cached
from lightprobe.light.resize import rotate_light
from lightprobe.reconstruction.lights import solve_target_light
from lightprobe.reconstruction.trials.plausibility import (
    BackgroundLevel,
    MetalReflectance,
    ViewLightCorrelation,
    background_level,
    light_level,
)
from lightprobe.render.split_sum import shade
from lightprobe.scene.background import load_background
from lightprobe.scene.photo import Photo
from tests.gbuffers import R, sky, sphere_gbuffer, turned
from tests.shapes import camera_at

CONFIG = DecomposeConfig()
FRONT = torch.tensor([1.0, 0.0, 0.0])
UP = torch.tensor([0.0, 0.0, 1.0])


def skies(angles):
    return [rotate_light(sky(R), turned(angle), R) for angle in angles]


def around(count):
    """Angles of `count` lights, evenly all around."""
    return [2 * math.pi * (k + 0.17) / count for k in range(count)]


def test_lights_from_all_sides_are_likely():
    bias = ViewLightCorrelation.of(skies(around(12)), [FRONT] * 12, UP)
    assert abs(bias.mean) < 0.02
    assert bias.nll < 0.1


def test_lights_from_behind_are_less_likely_than_lights_from_the_front():
    # Suns in front, up to 52 degrees off.
    spread = [math.atan2(0.4, 0.6) + 0.9 * math.sin(5 * k) for k in range(16)]
    front, behind = (
        ViewLightCorrelation.of(skies([a - side for a in spread]), [FRONT] * 16, UP)
        for side in (0.0, math.pi)
    )
    assert front.mean == pytest.approx(-behind.mean, abs=0.02)
    assert front.mean > 0.3
    assert 1 < front.nll < 3 < behind.nll


@pytest.mark.parametrize("rotation", [turned(-1.0), torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])])
def test_it_is_the_camera_s_side_whatever_the_frame(rotation):
    """Also where up is not z, as in the frames of programs whose y axis points down."""
    lights, towards = skies([0.3 * k for k in range(8)]), [FRONT + 0.1 * k * UP for k in range(8)]
    usual = ViewLightCorrelation.of(lights, towards, UP)
    moved = [rotate_light(light, rotation, R) for light in lights]
    found = ViewLightCorrelation.of(moved, [2 * at @ rotation for at in towards], UP @ rotation)
    assert found.mean == pytest.approx(usual.mean, abs=0.02)
    assert found.error == pytest.approx(usual.error, rel=0.05)


def test_photos_of_one_light_as_the_camera_sees_it_count_as_one():
    turntable = ViewLightCorrelation.of(skies([math.pi] * 32), [FRONT] * 32, UP)
    assert turntable.mean < -0.2
    assert turntable.error == pytest.approx(0.3, rel=0.02)
    assert turntable.nll < 2


def test_few_photos_or_none_from_the_side_say_nothing():
    assert ViewLightCorrelation.of(skies(around(7)), [FRONT] * 7, UP) is None
    assert ViewLightCorrelation.of(skies(around(9)), [FRONT] * 7 + [UP] * 2, UP) is None


@pytest.mark.slow
@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_a_surface_taken_for_too_bright_asks_for_light_from_behind(metallic):
    ball = sphere_gbuffer(800, roughness=0.3, metallic=metallic, base=(0.05, 0.05, 0.05))
    operator, biases = cached(CONFIG.light_resolution), []
    lights = [0.5 * rotate_light(sky(R), turned(angle), CONFIG.light_resolution) for angle in around(8)]
    for factor in (1.0, 8.0):
        taken, found = replace(ball, base_color=ball.base_color * factor), []
        for light in lights:
            photo = shade(ball, operator, operator.apply(light))
            grey, rows = torch.full_like(light, 0.5 / factor), torch.arange(len(photo))
            found.append(
                solve_target_light(photo, torch.zeros_like(photo).bool(), taken, grey, rows, CONFIG, 3)
            )
        biases.append(ViewLightCorrelation.of(found, [FRONT] * 8, UP))
    right, wrong = biases
    assert abs(right.mean) < 0.1
    assert wrong.mean < right.mean - 0.15


CAMERA = camera_at((0, -3, 0), size=100, focal=100.0)


def photo(folder, color: np.ndarray, object_share: float = 0.3, alpha: np.ndarray | None = None) -> Photo:
    """A photo (100, 100, 3) whose object, white, fills a square in the middle."""
    half = round(50 * math.sqrt(object_share))
    mask = np.zeros((100, 100, 3), np.float32)
    mask[50 - half : 50 + half, 50 - half : 50 + half] = 1
    write_png(folder / "photo.png", np.where(mask > 0, 1.0, color), alpha, bits=16)
    write_png(folder / "mask.png", mask, srgb=False)
    return Photo("photo", CAMERA, folder / "photo.png", folder / "mask.png")


def test_a_photo_shows_its_own_light_s_level(tmp_path):
    shown = background_level(load_background(photo(tmp_path, np.full((100, 100, 3), 0.2))))
    assert shown == pytest.approx(light_level(torch.full((6, 8, 8, 3), 0.2)), abs=1e-3)
    assert shown == pytest.approx(math.log(0.2 * 1.05), abs=1e-3)


def test_a_sun_in_the_light_hardly_counts():
    light = torch.full((6, 16, 16, 3), 0.2)
    light[4, 3, 5] = 1000.0
    assert light.mean() > 3 * 0.2
    assert light_level(light) - light_level(torch.full((6, 16, 16, 3), 0.2)) < 0.2


def test_what_is_cut_out_or_filled_by_the_object_shows_nothing(tmp_path):
    grey = np.full((100, 100, 3), 0.2)
    assert background_level(load_background(photo(tmp_path, grey, object_share=0.95))) is None
    cut = np.ones((100, 100), np.float32)
    cut[:10] = 0
    assert background_level(load_background(photo(tmp_path, grey, alpha=cut))) is None


def test_lights_that_are_too_dim_for_the_photos_are_unlikely():
    lights = [sky(R)] * 8
    shown = light_level(lights[0]) - 0.5  # of a light that holds a sun, as is usual
    usual = BackgroundLevel.of(lights, [shown] * 8)
    assert usual.excess == pytest.approx(0, abs=1e-5)
    assert usual.nll == pytest.approx(0, abs=1e-5)
    dim = BackgroundLevel.of([light / 9 for light in lights], [shown] * 8)
    assert dim.excess == pytest.approx(-math.log(9), abs=1e-4)
    assert dim.nll > 5
    twice = BackgroundLevel.of([light / 2 for light in lights], [shown] * 8)
    assert twice.nll < 1  # surroundings are no lightmeter


def test_photos_that_show_nothing_do_not_count():
    lights = [sky(R)] * 9
    assert BackgroundLevel.of(lights, [0.0] * 7 + [None] * 2) is None
    found, alike = BackgroundLevel.of(lights, [0.0] * 8 + [None]), BackgroundLevel.of(lights[:8], [0.0] * 8)
    assert found == alike


STEEL, GOLD, ALUMINIUM, BLUE = (0.56, 0.57, 0.58), (1.0, 0.71, 0.29), (0.91, 0.92, 0.92), (0.04, 0.06, 0.2)
PAINT = (0.1, 0.02, 0.02)


def metals_nll(*shares):
    base, metallic = points(*shares)
    return MetalReflectance.of(base, metallic).nll


def points(*shares):
    """Return base colours and metallic of 1000 points: (share, colour, metallic) each."""
    counts = [round(1000 * share) for share, _, _ in shares]
    base = torch.cat(
        [torch.tensor([color]).expand(n, 3) for n, (_, color, _) in zip(counts, shares, strict=True)]
    )
    return base, torch.cat([torch.full((n,), metal) for n, (_, _, metal) in zip(counts, shares, strict=True)])


@pytest.mark.parametrize("metal", [STEEL, GOLD, ALUMINIUM])
def test_metals_at_a_third_of_their_reflectance_are_unlikely(metal):
    base, metallic = points((0.3, metal, 0.9), (0.7, PAINT, 0.0))
    right, dark = (MetalReflectance.of(color, metallic) for color in (base, base / 3))
    assert right.share == dark.share == pytest.approx(0.3)
    assert right.nll < 1
    assert dark.nll > right.nll + 1.5


def test_the_brighter_of_two_metals_counts():
    both = metals_nll((0.2, BLUE, 1.0), (0.1, STEEL, 1.0), (0.7, PAINT, 0.0))
    assert both == pytest.approx(metals_nll((1.0, STEEL, 1.0)), abs=0.01)


def test_lacquered_metals_of_any_brightness_are_possible():
    blue, black = (metals_nll((1.0, color, 1.0)) for color in (BLUE, (0.01, 0.01, 0.01)))
    assert 2 < blue < 5
    assert black < 10


def test_what_is_far_darker_than_the_rest_is_no_metal():
    leather = (0.02, 0.015, 0.01)
    assert metals_nll((0.5, leather, 1.0), (0.5, STEEL, 0.0)) == 0
    gilt = metals_nll((0.06, GOLD, 1.0), (0.94, leather, 1.0))
    assert gilt == pytest.approx(metals_nll((1.0, GOLD, 1.0)), abs=0.01)


def test_paint_with_specks_of_metal_says_nothing():
    assert metals_nll((0.03, BLUE, 1.0), (0.97, PAINT, 0.0)) == 0
    assert metals_nll((1.0, BLUE, 0.4)) == 0

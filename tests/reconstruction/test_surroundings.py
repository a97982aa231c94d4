"""What photos show around the object, compared with the lights that are solved for them."""

import math

import numpy as np
import pytest
import torch

from lightprobe.imaging import write_png
from lightprobe.reconstruction.trials.plausibility import Surroundings, light_level, shown_level
from lightprobe.scene.photo import Photo
from tests.gbuffers import R, sky
from tests.shapes import camera_at

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
    shown = shown_level(photo(tmp_path, np.full((100, 100, 3), 0.2)))
    assert shown == pytest.approx(light_level(torch.full((6, 8, 8, 3), 0.2)), abs=1e-3)
    assert shown == pytest.approx(math.log(0.2 * 1.05), abs=1e-3)


def test_a_sun_in_the_light_hardly_counts():
    light = torch.full((6, 16, 16, 3), 0.2)
    light[4, 3, 5] = 1000.0
    assert light.mean() > 3 * 0.2
    assert light_level(light) - light_level(torch.full((6, 16, 16, 3), 0.2)) < 0.2


def test_what_is_cut_out_or_filled_by_the_object_shows_nothing(tmp_path):
    grey = np.full((100, 100, 3), 0.2)
    assert shown_level(photo(tmp_path, grey, object_share=0.95)) is None
    cut = np.ones((100, 100), np.float32)
    cut[:10] = 0
    assert shown_level(photo(tmp_path, grey, alpha=cut)) is None


def test_lights_that_are_too_dim_for_the_photos_are_unlikely():
    lights = [sky(R)] * 8
    shown = light_level(lights[0]) - 0.5  # of a light that holds a sun, as is usual
    usual = Surroundings.of(lights, [shown] * 8)
    assert usual.excess == pytest.approx(0, abs=1e-5)
    assert usual.surprise == pytest.approx(0, abs=1e-5)
    dim = Surroundings.of([light / 9 for light in lights], [shown] * 8)
    assert dim.excess == pytest.approx(-math.log(9), abs=1e-4)
    assert dim.surprise > 5
    twice = Surroundings.of([light / 2 for light in lights], [shown] * 8)
    assert twice.surprise < 1  # surroundings are no lightmeter


def test_photos_that_show_nothing_do_not_count():
    lights = [sky(R)] * 9
    assert Surroundings.of(lights, [0.0] * 7 + [None] * 2) is None
    found, alike = Surroundings.of(lights, [0.0] * 8 + [None]), Surroundings.of(lights[:8], [0.0] * 8)
    assert found == alike

"""The trusted pixels of a photo: which they are, what they hold, and how well mask and object agree."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.prediction.observation import observe
from lightprobe.scene.photo import Pixels
from tests.lit_sphere import CPU, glossy_sphere, patch_light, photograph
from tests.shapes import camera_at

DISTANCE, FOCAL = 3.2, 85.0
CAMERA = camera_at(DISTANCE * np.array([0.8, 0.48, 0.36]), size=64, focal=FOCAL)


@pytest.fixture(scope="module")
def sphere():
    return glossy_sphere()


@pytest.fixture(scope="module")
def photo(sphere):
    return photograph(sphere, CAMERA, patch_light((0.2, 1.0, 0.5)))


def test_trusted_pixels_lie_in_the_mask_and_hold_the_photo_s_colours(sphere, photo):
    half = replace(photo, alpha=photo.alpha.copy())
    half.alpha[:, :30] = 0
    half.alpha[:, 30] *= 0.8  # not covered enough
    seen = observe(sphere, half, CAMERA, CPU, 65_536)
    at = seen.gbuffer.pixel[seen.rows].numpy()
    assert (at % 64 > 30).all()
    assert len(at) == int(((photo.alpha > 0.9) & (np.arange(64) > 30)).sum())
    np.testing.assert_array_equal(seen.pixels.color.numpy(), photo.color.reshape(-1, 3)[at])
    np.testing.assert_array_equal(seen.clipped.numpy(), photo.clipped.reshape(-1, 3)[at])
    assert torch.equal(seen.pixels.normal, seen.gbuffer.normal[seen.rows])


def test_its_own_mask_fits_the_object(sphere, photo):
    seen = observe(sphere, photo, CAMERA, CPU, 65_536)
    assert seen.overlap == 1
    assert seen.offset == 0


@pytest.mark.parametrize(("down", "across"), [(3, 0), (0, -3), (4, 3)])
def test_a_moved_mask_is_off_by_its_move(sphere, photo, down, across):
    """A pixel is 1 / focal wide at distance 1, and the object is that many times as far away."""
    moved = Pixels.of(*(np.roll(part, (down, across), (0, 1)) for part in (photo.color, photo.alpha)))
    seen = observe(sphere, moved, CAMERA, CPU, 65_536)
    assert seen.offset == pytest.approx(np.hypot(down, across) / FOCAL * DISTANCE, rel=1e-3)
    assert seen.overlap < 0.95


def test_the_light_level_is_the_constant_light_s_radiance(sphere):
    for radiance in (0.25, 0.5):
        white = photograph(sphere, CAMERA, torch.full((6, 16, 16, 3), radiance))
        assert float(observe(sphere, white, CAMERA, CPU, 65_536).light_level) == pytest.approx(
            radiance, rel=0.01
        )


def test_large_photos_are_reduced_to_about_as_many_pixels(sphere, photo):
    whole, small = (observe(sphere, photo, CAMERA, CPU, count) for count in (65_536, 500))
    assert len(whole.rows) > 1500
    assert 350 < len(small.rows) <= 550
    assert float(small.light_level) == pytest.approx(float(whole.light_level), rel=0.02)


def test_what_shows_nothing_is_refused(sphere, photo):
    with pytest.raises(InputError, match="64 x 64 pixels but its camera 32 x 32"):
        observe(sphere, photo, CAMERA.resized(32, 32), CPU, 65_536)
    with pytest.raises(InputError, match="Only 0 pixels of the mask"):
        observe(sphere, Pixels.of(photo.color, np.zeros_like(photo.alpha)), CAMERA, CPU, 65_536)

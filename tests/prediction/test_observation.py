"""The trusted pixels of a photo: which they are, what they hold, and how well mask and object agree."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.evaluation.metrics import environment_log_rmse, log_difference
from lightprobe.light import prefilter
from lightprobe.prediction import Method, PredictConfig, Predictor
from lightprobe.prediction.observation import exposed, joined, observe, relative_exposures
from lightprobe.prediction.verdict import judge
from lightprobe.render.transport import Transport
from lightprobe.scene.photo import Pixels
from tests.lit_sphere import CPU, patch_light, photograph
from tests.shapes import camera_at

DISTANCE, FOCAL = 3.2, 85.0
CAMERA = camera_at(DISTANCE * np.array([0.8, 0.48, 0.36]), size=64, focal=FOCAL)
SIDES = ((2.6, 1.4, 1.2), (-2.0, 2.2, 0.6), (0.4, -2.9, 1.0))
CAMERAS = [
    camera_at(place, size=48 + 8 * number, focal=64.0 + 10 * number) for number, place in enumerate(SIDES)
]
LIGHT = patch_light((0.2, 1.0, 0.5)) + 0.5 * patch_light((-0.5, -0.8, 0.4))
FACTORS = (1.0, 2.5, 0.6)


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


@pytest.mark.parametrize(
    ("spoilt", "sentence"),
    [
        (lambda mask: 1 - mask, "the mask looks inverted"),
        (lambda mask: np.rot90(mask), "turned by 90 degrees it would fit"),
        (lambda mask: np.rot90(mask, 2), "upside down"),
        (lambda mask: np.rot90(mask, -1), "turned by 270 degrees it would fit"),
        (lambda mask: mask[:, ::-1], "mirrored"),
        (lambda mask: np.roll(mask, 30, 0), None),
    ],
)
def test_a_mask_that_is_turned_or_inverted_is_told_by_what_would_mend_it(sphere, spoilt, sentence):
    camera = replace(camera_at((0.0, -4.5, 0.1), size=64, focal=60.0), cx=24.0, cy=18.0)
    photo = photograph(sphere, camera, LIGHT)
    wrong = Pixels.of(photo.color, spoilt(photo.alpha).copy())
    assert observe(sphere, photo, camera, CPU, 65_536).mask_mistake is None
    told = what_is_told(sphere, wrong, camera)
    assert (sentence or "check the pose and the mask") in told


def what_is_told(asset, photo, camera) -> str:
    try:
        return " ".join(judge(observe(asset, photo, camera, CPU, 65_536), 0).sentences)
    except InputError as error:
        return str(error)


@pytest.fixture(scope="module")
def photos(sphere):
    return [photograph(sphere, camera, LIGHT) for camera in CAMERAS]


@pytest.fixture(scope="module")
def seen(sphere, photos):
    return [
        observe(sphere, photo, camera, CPU, 65_536) for photo, camera in zip(photos, CAMERAS, strict=True)
    ]


@pytest.fixture(scope="module")
def predictor(decomposition):
    return Predictor(decomposition, config=PredictConfig(light_resolution=16))


def scaled(photo, factor):
    return Pixels(photo.color * np.float32(factor), photo.alpha, photo.clipped)


def test_joined_photos_hold_the_pixels_of_each_and_render_them(seen):
    joint, operator = joined(seen), prefilter.cached(16, CPU)
    assert len(joint.rows) == sum(len(one.rows) for one in seen)
    assert (joint.gbuffer.height, joint.gbuffer.width) == (48 + 56 + 64, 64)
    apart = torch.cat([Transport(one.gbuffer, operator, one.rows).apply(LIGHT) for one in seen])
    together = Transport(joint.gbuffer, operator, joint.rows).apply(LIGHT)
    torch.testing.assert_close(together, apart)
    torch.testing.assert_close(together, joint.pixels.color, rtol=1e-4, atol=1e-5)
    assert (joint.overlap, joint.offset) == (min(o.overlap for o in seen), max(o.offset for o in seen))


def test_an_exposed_photo_has_its_colours_and_level_divided(seen):
    half = exposed(seen[0], torch.tensor(2.0))
    torch.testing.assert_close(half.pixels.color, seen[0].pixels.color / 2)
    torch.testing.assert_close(half.light_level, seen[0].light_level / 2)


@pytest.mark.long
def test_exposures_are_found_with_the_light(sphere, photos):
    seen = [
        observe(sphere, scaled(photo, factor), camera, CPU, 65_536)
        for photo, factor, camera in zip(photos, FACTORS, CAMERAS, strict=True)
    ]
    found = relative_exposures(seen, 0).log().numpy()[1:] / np.log(FACTORS[1:])
    assert (found > 0.55).all()  # towards 1, as the coarse light cannot draw a glossy sphere's highlights
    assert (found < 1.05).all()
    assert torch.equal(relative_exposures(seen, 0), relative_exposures(seen, 0))


@pytest.mark.slow
def test_a_photo_that_is_white_all_over_keeps_the_usual_exposure(sphere, photos, seen):
    clipped = Pixels(np.ones_like(photos[1].color), photos[1].alpha, np.ones_like(photos[1].clipped))
    white = observe(sphere, clipped, CAMERAS[1], CPU, 65_536)
    assert float(relative_exposures([seen[0], white, seen[2]], 0)[1]) == pytest.approx(1, rel=0.1)


@pytest.mark.slow
def test_what_no_light_explains_hardly_tells_its_exposure(sphere, photos):
    random = np.random.default_rng(0).uniform(0, 6, photos[1].color.shape).astype(np.float32)
    noise = Pixels(random * photos[1].alpha[..., None], photos[1].alpha, photos[1].clipped)
    views = ((photos[0], CAMERAS[0]), (noise, CAMERAS[1]))
    pair = [observe(sphere, photo, camera, CPU, 65_536) for photo, camera in views]
    plain = float(noise.color[noise.alpha > 0].mean() / photos[1].color[photos[1].alpha > 0].mean())
    assert plain > 3
    assert float(relative_exposures(pair, 0)[1]) < plain**0.5


@pytest.mark.slow
def test_three_views_of_one_light_tell_more_than_any_of_them(predictor, photos):
    views = [
        (scaled(photo, factor), camera)
        for photo, factor, camera in zip(photos, FACTORS, CAMERAS, strict=True)
    ]
    joint, exposures = predictor.predict_together(views, Method.SOLVE, exposures=FACTORS)
    error = environment_log_rmse(log_difference(joint.environment.texels, LIGHT))
    singly = [
        environment_log_rmse(
            log_difference(predictor.predict(*view, Method.SOLVE).environment.texels / factor, LIGHT)
        )
        for view, factor in zip(views, FACTORS, strict=True)
    ]
    assert error < 0.95 * min(singly)
    assert error < 0.8 * sum(singly) / len(singly)
    np.testing.assert_allclose(exposures.numpy(), FACTORS)


@pytest.mark.slow
def test_given_exposures_are_taken_as_they_are(predictor, photos):
    views = list(zip(photos, CAMERAS, strict=True))
    plain, ones = predictor.predict_together(views, Method.SOLVE, exposures=(2.0, 2.0, 2.0))
    assert ones.tolist() == [1.0, 1.0, 1.0]
    error = environment_log_rmse(log_difference(plain.environment.texels, LIGHT))
    wrong, _ = predictor.predict_together(views, Method.SOLVE, exposures=(1.0, 4.0, 0.25))
    assert error < 0.7 * environment_log_rmse(log_difference(wrong.environment.texels, LIGHT))


@pytest.mark.slow
def test_one_photo_together_is_the_photo_alone(predictor, photos):
    together, exposures = predictor.predict_together([(photos[0], CAMERAS[0])], Method.SOLVE)
    alone = predictor.predict(photos[0], CAMERAS[0], Method.SOLVE)
    torch.testing.assert_close(together.environment.texels, alone.environment.texels, rtol=0.02, atol=1e-3)
    assert exposures.tolist() == [1.0]


@pytest.mark.slow
def test_photos_that_no_one_light_explains_are_refused(predictor, photos):
    other = Pixels.of(photos[1].color.max() - photos[1].color, photos[1].alpha)
    with pytest.raises(ConfigError, match="No photo"):
        predictor.predict_together([])
    with pytest.raises(InputError, match="No light"):
        predictor.predict_together([(other, CAMERAS[1])], Method.SOLVE)

"""The guard of the second pass: the true asset explains its photos best, under the light they were taken in."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.reconstruction import validation
from lightprobe.reconstruction.lights import FINAL_REGULARISATION, REGULARISATION, LightPull
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.trials.plausibility import BackgroundLevel, ViewLightCorrelation
from lightprobe.reconstruction.validation import fit_light, judge_object, validate
from lightprobe.render.surface import View
from tests.lit_sphere import CPU, PATCHES, glossy_sphere, patch_light, photograph
from tests.shapes import camera_at

CONFIG = DecomposeConfig(shadows=False, light_resolution=16)


def targets(asset, count=2):
    found = []
    for k, patch in enumerate(PATCHES[:count]):
        camera = camera_at((2.6 - k, 1.4 * (-1) ** k, 1.2), size=48, focal=60.0)
        photo = photograph(asset, camera, patch_light(patch))
        color, clipped = (torch.from_numpy(part).reshape(-1, 3) for part in (photo.color, photo.clipped))
        alpha = torch.from_numpy(photo.alpha).reshape(-1)
        found.append(Target(f"photo{k}", View.of(camera, CPU), color * alpha[:, None], alpha, clipped))
    return found


def recolored(asset, color):
    return replace(asset, textures=replace(asset.textures, base_color=color.contiguous()))


@pytest.mark.slow
def test_the_true_asset_scores_best():
    true = glossy_sphere()
    photos, color = targets(true), true.textures.base_color
    plain = recolored(true, color.mean((0, 1)).expand_as(color))
    mirrored = recolored(true, color.flip(1))
    best, *others = (validate(asset, photos, CONFIG, 0) for asset in (true, plain, mirrored))
    assert best > 30
    assert best > max(others) + 8
    assert best == validate(true, photos, CONFIG, 0)


def test_the_light_is_found_where_the_ball_shows_it():
    true = glossy_sphere()
    (photo,) = targets(true, 1)
    gbuffer, light = fit_light(true, photo, 16, CONFIG, 0)
    expected = patch_light(PATCHES[0])
    assert light.shape == expected.shape
    assert len(gbuffer.pixel) == int((photo.alpha > 0).sum())
    inside = expected[..., 0] > 1
    assert float(light[inside].mean() / light[~inside].mean()) > 5


@pytest.mark.parametrize("exposure", [0.02, 0.001])
def test_the_light_of_a_dark_photo_is_found_as_well(exposure):
    true = glossy_sphere()
    (photo,) = targets(true, 1)
    _, light = fit_light(true, photo, 16, CONFIG, 0)
    _, dim = fit_light(true, replace(photo, color=exposure * photo.color), 16, CONFIG, 0)
    expected = patch_light(PATCHES[0]).log()
    errors = [
        float(((found.clamp(min=1e-3)).log() - expected).square().mean() ** 0.5)
        for found in (light, dim / exposure)
    ]
    assert errors[1] < 1.1 * errors[0]


def test_a_light_of_an_asset_that_stays_is_pulled_as_final_lights_are(monkeypatch):
    true = glossy_sphere()
    (photo,) = targets(true, 1)
    pulls, solve = [], validation.solve_target_light

    def watched(*given, regularisation, **named):
        pulls.append((regularisation, named["pull"].shape))
        return solve(*given, regularisation=regularisation, **named)

    monkeypatch.setattr(validation, "solve_target_light", watched)
    fit_light(true, photo, 16, CONFIG, 0)
    fit_light(true, photo, 16, CONFIG, 0, pull=LightPull(torch.ones(6, 8, 8, 3)))
    assert [pull for pull, _ in pulls] == 2 * [FINAL_REGULARISATION]
    assert FINAL_REGULARISATION > REGULARISATION
    assert pulls[0][1] is None
    assert pulls[1][1].shape == (6, 16, 16, 3)


def test_a_light_to_start_from_may_be_coarser():
    true = glossy_sphere()
    (photo,) = targets(true, 1)
    _, coarse = fit_light(true, photo, 8, CONFIG, 0)
    _, fine = fit_light(true, photo, 16, CONFIG, 0, start=coarse)
    assert fine.shape == (6, 16, 16, 3)


@pytest.mark.parametrize("start", [None, 2.0])
def test_a_photo_that_shows_nothing_leaves_the_light_as_it_was(start):
    true = glossy_sphere()
    (photo,) = targets(true, 1)
    hidden = replace(photo, alpha=torch.zeros_like(photo.alpha))
    given = None if start is None else torch.full((6, 8, 8, 3), start)
    _, light = fit_light(true, hidden, 16, CONFIG, 0, start=given)
    torch.testing.assert_close(light, torch.full((6, 16, 16, 3), start or 0.5))


@pytest.mark.long
def test_parts_of_the_true_asset_agree_about_the_light_better_than_those_of_a_wrong_one():
    true = glossy_sphere()
    photos, color = targets(true), true.textures.base_color
    wrong = recolored(true, color.flip(1))
    best, other = (judge_object(asset, photos, None, None, CONFIG, 0) for asset in (true, wrong))
    assert best.photos == other.photos == 2
    assert best.disagreement < 0.5 * other.disagreement
    assert best == judge_object(true, photos, None, None, CONFIG, 0)
    told = judge_object(true, photos, ViewLightCorrelation(-0.3, 0.1), None, CONFIG, 0)
    assert (told.disagreement, told.front_bias) == (best.disagreement, -0.3)
    assert told.surprise == pytest.approx(4.5)
    told = judge_object(true, photos, None, BackgroundLevel(-1.0), CONFIG, 0)
    assert (told.disagreement, told.excess, told.excess_surprise) == (
        best.disagreement,
        -1.0,
        pytest.approx(2.0),
    )


def test_photos_that_do_not_show_the_object_give_no_verdict():
    (photo,) = targets(glossy_sphere(), 1)
    hidden = replace(photo, alpha=torch.zeros_like(photo.alpha))
    assert judge_object(glossy_sphere(), [hidden], None, None, CONFIG, 0) is None
    assert judge_object(glossy_sphere(), [], None, None, CONFIG, 0) is None

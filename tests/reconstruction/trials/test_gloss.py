"""A glossier start: a glossy ball that was taken for a rough one is found glossy, a matte one grows rough again."""

import copy
from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.light.prefilter import cached
from lightprobe.light.resize import rotate_light
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.material_field import ScaledMaterial, fit_field
from lightprobe.reconstruction.trials.gloss import glossier_start
from lightprobe.reconstruction.trials.trial import Sample, Trial, TrialPhotos
from lightprobe.render.split_sum import shade
from tests.gbuffers import R, sky, sphere_gbuffer, turned

CPU = torch.device("cpu")
CONFIG = DecomposeConfig(hash_levels=4, hash_finest=32, trial_steps=40)
PAINT = torch.tensor([0.5, 0.1, 0.1])
RELIEF = torch.tensor([0.06, -0.04, 0.02])  # normal offsets that the material has learnt


def photos(roughness: float, count: int = 8) -> TrialPhotos:
    """Photos of a painted ball under turned lights, each with a light to start from that suits it."""
    ball = sphere_gbuffer(600, roughness=roughness)
    ball = replace(ball, base_color=PAINT.expand(len(ball.pixel), 3), metallic=torch.zeros(len(ball.pixel)))
    operator, samples = cached(R), []
    lights = Lights([f"photo{k}" for k in range(count)], CONFIG, CPU, 0)
    for k in range(count):
        light = rotate_light(0.5 * sky(R).clamp(max=3), turned(k), R)
        photo = shade(ball, operator, operator.apply(light))
        light, photo = (x * 0.22 / photo.mean() for x in (light, photo))
        lights.replace(f"photo{k}", light)
        clipped = torch.zeros_like(photo, dtype=torch.bool)
        samples.append(Sample(f"photo{k}", ball, photo, clipped, 0.5, torch.tensor([0.0, 0.0, 1.0])))
    return TrialPhotos(samples, lights, 0, decided=True)


def taken_for(seen: TrialPhotos, roughness: float) -> ScaledMaterial:
    """The ball's material, its roughness another than it is."""
    material = ScaledMaterial(float(PAINT.mean()), CONFIG, CPU, 0)
    wanted = torch.cat([PAINT, torch.tensor([roughness, 0.0]), RELIEF]).expand(600, 8)
    fit_field(material, seen.samples[0].pixels.position, wanted, 0)
    return material


def roughness_of(trial: Trial) -> float:
    return float(trial.material(trial.samples[0].pixels.position).detach()[:, 3].mean())


@pytest.mark.slow
def test_a_glossy_ball_that_was_taken_for_a_rough_one_is_found_out():
    seen = photos(0.15)
    material = taken_for(seen, 0.4)
    before = copy.deepcopy(material.state_dict())
    trial = glossier_start(seen, material)
    assert trial is not None
    assert roughness_of(trial) < 0.2 < roughness_of(Trial(taken_for(seen, 0.4), seen, 20))
    offsets = trial.material(seen.samples[0].pixels.position).detach()[:, 5:]
    assert float((offsets - RELIEF).abs().mean()) < 0.01
    assert all(torch.equal(before[name], value) for name, value in material.state_dict().items())


@pytest.mark.slow
def test_a_matte_ball_grows_rough_again():
    seen = photos(0.6)
    trial = glossier_start(seen, taken_for(seen, 0.6))
    assert trial is not None
    assert roughness_of(trial) > 0.4  # it started at .3


def test_nothing_starts_over_without_photos():
    lights = Lights(["photo0"], CONFIG, CPU, 0)
    assert glossier_start(TrialPhotos([], lights, 0), ScaledMaterial(0.3, CONFIG, CPU, 0)) is None

"""What is metal is tried: a gilt part that was taken for paint is found out, and paint stays paint."""

import copy
from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.light.prefilter import cached
from lightprobe.light.resize import rotate_light
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.material_field import ScaledMaterial
from lightprobe.reconstruction.trials import metals
from lightprobe.reconstruction.trials.metals import HeldMetallic, Materials, best_metals
from lightprobe.reconstruction.trials.trial import Sample, Trial, TrialPhotos
from lightprobe.render.split_sum import shade
from tests.gbuffers import R, sky, sphere_gbuffer, turned

RELIEF = torch.tensor([0.06, -0.04, 0.02])  # normal offsets that the material has learnt
UP = torch.tensor([0.0, 0.0, 1.0])
CPU = torch.device("cpu")
CONFIG = DecomposeConfig(hash_levels=4, hash_finest=32, trial_steps=80)
GOLD, PAINT = (0.8, 0.5, 0.15), (0.5, 0.45, 0.4)


def truth(position, gilt: bool):
    """Channels (N, 5) of a painted ball whose right half is gilt, or painted in gold's colour."""
    right = (position[:, 1] > 0)[:, None]
    color = torch.where(right, torch.tensor(GOLD), torch.tensor(PAINT))
    rest = torch.where(right, torch.tensor([0.25, float(gilt)]), torch.tensor([0.5, 0.0]))
    return torch.cat([color, rest], 1)


def photos(gilt: bool, count=10):
    """Return samples of the ball under turned lights, and lights to start from."""
    ball = sphere_gbuffer(600, roughness=0.25)
    channels = truth(ball.position, gilt)
    ball = replace(ball, base_color=channels[:, :3], roughness=channels[:, 3], metallic=channels[:, 4])
    operator, samples = cached(R), []
    lights = Lights([f"photo{k}" for k in range(count)], CONFIG, CPU, 0)
    for k in range(count):
        light = rotate_light(0.5 * sky(R).clamp(max=3), turned(k), R)
        photo = shade(ball, operator, operator.apply(light))
        light, photo = (x * 0.22 / photo.mean() for x in (light, photo))
        lights.replace(f"photo{k}", light)
        samples.append(Sample(f"photo{k}", ball, photo, torch.zeros_like(photo, dtype=torch.bool), 0.5, UP))
    return samples, lights


def painted(samples, gilt: bool) -> ScaledMaterial:
    """The material that has learnt all of the ball but whether its right half is gilt."""
    material = ScaledMaterial(0.45, CONFIG, CPU, 0)
    position = samples[0].pixels.position
    channels = truth(position, gilt)
    if not gilt:
        channels[:, :3] *= torch.where(position[:, 1:2] > 0, 0.6, 1.0)
    metals._fit_field(material, position, torch.cat([channels, RELIEF.expand(len(position), 3)], 1), 0)
    return material


@pytest.mark.long
def test_a_gilt_part_that_was_taken_for_paint_becomes_metal():
    samples, lights = photos(gilt=True)
    material = painted(samples, gilt=False)
    before = copy.deepcopy(material.state_dict())
    trial = best_metals(TrialPhotos(samples, lights, 0), material)
    assert trial is not None
    assert trial.material.held == []
    position = samples[0].pixels.position
    metallic = trial.material(position).detach()[:, 4]
    assert float(metallic[position[:, 1] > 0.1].mean()) > 0.8
    assert float(metallic[position[:, 1] < -0.1].mean()) < 0.2
    assert float((trial.material(position).detach()[:, 5:] - RELIEF).abs().mean()) < 0.01
    assert all(torch.equal(before[name], value) for name, value in material.state_dict().items())


@pytest.mark.long
def test_paint_stays_paint():
    samples, lights = photos(gilt=False)
    assert best_metals(TrialPhotos(samples, lights, 0), painted(samples, gilt=False)) is None


@pytest.mark.slow
def test_without_enough_photos_nothing_is_tried():
    samples, lights = photos(gilt=True, count=7)
    assert best_metals(TrialPhotos(samples, lights, 0), painted(samples, gilt=False)) is None


@pytest.mark.slow
def test_a_change_is_held_while_all_else_is_fitted(monkeypatch):
    samples, lights = photos(gilt=True, count=2)
    material = painted(samples, gilt=False)
    position = samples[0].pixels.position
    materials = Materials.of(material, position, 0)
    right = position[:, 1] > 0.1
    number = int(materials.at(position)[right].mode().values)
    held = metals._changed(material, materials, number, position, 0)
    assert float((held(position).detach()[:, 5:] - RELIEF).abs().mean()) < 0.01
    Trial(held, TrialPhotos(samples, lights, 0), steps=4)
    there = materials.at(position) == number
    assert (held(position)[there, 4] == 0.95).all()
    assert float(held(position).detach()[~there, 4].mean()) < 0.2
    held.held = []
    assert float(held(position).detach()[there, 4].mean()) > 0.7  # the field has learnt it, too


def points(count=200):
    return 2 * torch.rand(count, 3, generator=torch.Generator().manual_seed(0)) - 1


def halves(points):
    """A material that is a red paint where x < 0 and a rough grey metal elsewhere."""
    left = points[:, :1] < 0
    red, grey = (
        torch.tensor(row)
        for row in ([0.6, 0.05, 0.05, 0.3, 0.0, 0, 0, 0], [0.3, 0.3, 0.3, 0.6, 1.0, 0, 0, 0])
    )
    return torch.where(left, red, grey)


def test_points_are_sorted_into_the_materials_they_are_of(monkeypatch):
    material = ScaledMaterial(0.3, CONFIG, CPU, 0)
    monkeypatch.setattr(ScaledMaterial, "forward", lambda self, points: halves(points))
    materials = Materials.of(material, points(), 0)
    number = materials.at(points())
    left = points()[:, 0] < 0
    assert set(number[left].tolist()) & set(number[~left].tolist()) == set()
    assert sum(materials.shares(points())) == pytest.approx(1.0)


def test_the_metallic_of_one_material_is_held_whatever_the_field_becomes(monkeypatch):
    material = ScaledMaterial(0.3, CONFIG, CPU, 0)
    with monkeypatch.context() as patched:
        patched.setattr(ScaledMaterial, "forward", lambda self, points: halves(points))
        materials = Materials.of(material, points(), 0)
        number = materials.at(points())
        monkeypatch.setattr(Materials, "at", lambda self, _: number)
    before = material(points())
    chosen = int(number[0])
    material.held = [HeldMetallic(materials, chosen, 0.9)]
    after = material(points())
    assert (after[number == chosen, 4] == 0.9).all()
    assert torch.equal(after[number != chosen], before[number != chosen])
    assert torch.equal(after[:, :4], before[:, :4])

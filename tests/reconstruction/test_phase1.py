"""What Phase I keeps of a pass that made things worse, and what it says of an object of few photos."""

import itertools
from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig, LightUpdate
from lightprobe.reconstruction import phase1
from lightprobe.reconstruction.photos import Target, evenly_spaced
from lightprobe.scene import load_scene
from tests.toy_scene import write_toy_scene

CONFIG = DecomposeConfig(
    pass1_iterations=4,
    pass2_iterations=3,
    pass3_iterations=3,
    pass1_side=24,
    pass2_side=24,
    lattice_cells=8,
    hull_voxels=16,
    hash_levels=2,
    hash_finest=16,
    light_resolution=8,
    teacher_resolution=8,
    texture_size=64,
    pass3_texture_size=64,
    light_update=LightUpdate.GRADIENT,
    unwrap_seconds=0.0,
    shadows=False,
)


@pytest.mark.slow
@pytest.mark.parametrize("kept", [True, False])
def test_lights_of_a_pass_that_is_not_kept_go_with_it(tmp_path, monkeypatch, kept):
    scene = load_scene(write_toy_scene(tmp_path, train=4, test=1))
    handed, first_pass = [], phase1._Phase.first_pass
    monkeypatch.setattr(phase1._Phase, "first_pass", lambda *a: handed.append(first_pass(*a)) or handed[-1])
    # Four photos are too few to hold one out; here one serves twice.
    monkeypatch.setattr(phase1, "split_validation", lambda photos, count: (list(photos), [photos[0]]))
    scores = itertools.count(0.0, 1.0 if kept else -1.0)
    monkeypatch.setattr(phase1, "validate", lambda *a: next(scores))
    found = phase1.decompose(scene, CONFIG)
    before = {photo.name: light for photo, light in zip(scene.train, handed[0].lights, strict=True)}
    assert all(torch.equal(found.lights[name].texels, light) for name, light in before.items()) is not kept


@pytest.mark.slow
def test_held_out_photos_that_are_too_thin_to_judge_by_judge_nothing(tmp_path, monkeypatch):
    scene = load_scene(write_toy_scene(tmp_path, train=4, test=1))
    monkeypatch.setattr(phase1, "split_validation", lambda photos, count: (list(photos), [photos[0]]))
    monkeypatch.setattr(Target, "covered", property(lambda self: self.alpha > 2))
    monkeypatch.setattr(phase1, "validate", lambda *_: pytest.fail("a mean over no pixels"))
    handed, first_pass = [], phase1._Phase.first_pass
    monkeypatch.setattr(phase1._Phase, "first_pass", lambda *a: handed.append(first_pass(*a)) or handed[-1])
    found = phase1.decompose(scene, CONFIG)
    assert not torch.equal(
        found.lights[scene.train[0].name].texels, handed[0].lights[0]
    )  # refined, as without any


@pytest.mark.slow
def test_lights_of_one_place_end_more_alike(tmp_path):
    scene = load_scene(write_toy_scene(tmp_path, train=6, test=1))
    solved = replace(
        CONFIG,
        pass2_side=20,  # so that the third pass has something to add
        lattice_cells=12,
        hull_voxels=24,
        light_update=LightUpdate.SOLVE,
        light_solve_pixels=60,
    )
    grouped = [replace(photo, light_group="table") for photo in scene.train[:3]]
    together = replace(scene, train=(*grouped, *scene.train[3:]))

    def lights(of):
        found = phase1.decompose(of, solved)
        texels = [found.lights[photo.name].texels for photo in scene.train]
        return [light / light.mean() for light in texels]

    def spread(found):
        return float((torch.stack(found[:3]).std(0)).mean())

    alone, pulled = lights(scene), lights(together)
    assert spread(pulled) < 0.9 * spread(alone)
    assert all(torch.equal(a, b) for a, b in zip(pulled, lights(together), strict=True))


@pytest.mark.slow
def test_too_few_photos_to_hold_one_back_give_a_verdict_that_says_so(tmp_path):
    scene = load_scene(write_toy_scene(tmp_path, train=3, test=1))
    verdict = phase1.decompose(scene, CONFIG).verdict
    assert verdict is not None
    assert not verdict.held_out
    assert verdict.photos == 3


def test_photos_are_chosen_evenly():
    assert evenly_spaced(range(20), 8) == [1, 3, 6, 8, 11, 13, 16, 18]
    assert evenly_spaced(range(3), 8) == [0, 1, 2]
    assert evenly_spaced(range(0), 8) == []
    photos = tuple(range(24))
    assert phase1.split_validation(photos, 5)[1] == [4, 12, 20]  # an eighth at most
    assert phase1.split_validation(photos[:7], 5) == (list(photos[:7]), [])

"""Which training examples a scene gives: the photos with their Phase I lights, re-rendered ones, or both."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.config.distillation import DistillConfig, ExampleSource
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.distillation import examples
from lightprobe.distillation.examples import collect_examples
from lightprobe.light.environment import Environment
from lightprobe.scene import load_scene
from tests.lit_sphere import CORNER, CPU, glossy_sphere, lesson, patch_light
from tests.toy_scene import write_toy_scene

CONFIG = DistillConfig(synthetic_lessons=7, pixels_per_photo=600, light_resolution=8)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    scene = load_scene(write_toy_scene(tmp_path_factory.mktemp("toy")))
    lights = {
        photo.name: Environment(patch_light((1.0, 0.1 * k, 0.5))) for k, photo in enumerate(scene.train)
    }
    return glossy_sphere(), lights, scene


def collect(world, lessons, **options):
    return collect_examples(*world, replace(CONFIG, lessons=lessons), CPU, 0, **options)


@pytest.mark.slow
def test_each_choice_gives_its_lessons(world):
    photos = [photo.name for photo in world[2].train]
    teacher, synthetic, both = (collect(world, choice) for choice in ExampleSource)
    assert [each.name for each in teacher] == photos
    assert [each.name for each in synthetic] == [f"synthetic {k}" for k in range(7)]
    assert len(both) == len(photos) + 7
    for each in both:
        assert each.target.shape == (6 * 8 * 8, 3)
        assert each.target.isfinite().all()


def test_a_lesson_s_light_is_relative_to_its_photo_s_level():
    """Grey light of any strength is 1 to it, and of a photo three times as exposed it stays what it is."""
    asset, grey = glossy_sphere(), torch.full((6, 16, 16, 3), 0.1)
    dim = lesson(asset, CORNER, grey, "dim").target
    torch.testing.assert_close(dim, torch.ones_like(dim), rtol=0.02, atol=0)
    torch.testing.assert_close(lesson(asset, CORNER, 3 * grey, "bright").target, dim, rtol=1e-4, atol=0)
    lamp = 0.1 * patch_light((1.0, 0.3, 0.4))
    one, other = (lesson(asset, CORNER, factor * lamp, "lamp").target for factor in (1.0, 3.0))
    torch.testing.assert_close(other, one, rtol=1e-4, atol=1e-6)


@pytest.mark.slow
def test_equal_seeds_give_equal_lessons_and_progress_is_told(world):
    told = []
    first = collect(world, ExampleSource.SYNTHETIC, on_example=lambda *progress: told.append(progress))
    again = collect(world, ExampleSource.SYNTHETIC)
    assert all(torch.equal(a.pixels.color, b.pixels.color) for a, b in zip(first, again, strict=True))
    assert told[-1] == (len(world[2].train), len(world[2].train))


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [(0,), (1, 2), (-1,)])
def test_photos_that_show_too_little_leave_their_share_to_others(world, monkeypatch, hidden):
    names, told = [photo.name for photo in world[2].train], []
    unseen, load = {names[k] for k in hidden}, examples.load_pixels

    def load_hidden(photo, side):
        pixels, camera = load(photo, side)
        alpha = np.zeros_like(pixels.alpha) if photo.name in unseen else pixels.alpha
        return replace(pixels, alpha=alpha), camera

    monkeypatch.setattr(examples, "load_pixels", load_hidden)
    found = collect(world, ExampleSource.SYNTHETIC, on_example=lambda *progress: told.append(progress))
    assert [each.name for each in found] == [f"synthetic {k}" for k in range(7)]
    assert told[-1] == (len(names), len(names))


@pytest.mark.slow
def test_maps_of_the_user_are_lit_with(world):
    plain, lit = (
        collect(world, ExampleSource.SYNTHETIC, environments=maps)
        for maps in ([], [Environment(patch_light((0.0, 0.0, 1.0)))])
    )
    assert any(not torch.equal(a.target, b.target) for a, b in zip(plain, lit, strict=True))


def test_a_scene_without_the_object_and_an_unknown_choice_are_refused(world):
    with pytest.raises(InputError, match="shows the reconstructed object"):
        collect_examples(world[0], {}, world[2], CONFIG, CPU, 0)
    with pytest.raises(ConfigError, match="cannot be used"):
        DistillConfig.from_json({"lessons": "magic"})

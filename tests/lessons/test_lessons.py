"""Which lessons a scene gives: the photos with their teachers, re-rendered ones, or both."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.config.distillation import DistillConfig, Lessons
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.lessons.lessons import collect_lessons
from lightprobe.light.environment import Environment
from lightprobe.scene import load_scene
from tests.lit_sphere import CPU, glossy_sphere, patch_light
from tests.toy_scene import write_toy_scene

CONFIG = DistillConfig(synthetic_lessons=7, pixels_per_photo=600, light_resolution=8)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    scene = load_scene(write_toy_scene(tmp_path_factory.mktemp("toy")))
    lights = {photo.name: Environment(patch_light((1.0, 0.1 * k, 0.5))) for k, photo in enumerate(scene.train)}
    return glossy_sphere(), lights, scene


def collect(world, lessons, **options):
    return collect_lessons(*world, replace(CONFIG, lessons=lessons), CPU, 0, **options)


def test_each_choice_gives_its_lessons(world):
    photos = [photo.name for photo in world[2].train]
    teacher, synthetic, both = (collect(world, choice) for choice in Lessons)
    assert [lesson.name for lesson in teacher] == photos
    assert [lesson.name for lesson in synthetic] == [f"synthetic {k}" for k in range(7)]
    assert len(both) == len(photos) + 7
    for lesson in both:
        assert lesson.teacher.shape == (6 * 8 * 8, 3)
        assert lesson.teacher.isfinite().all()
        assert 0.1 < float(lesson.teacher.mean()) < 10, "the light is relative to the photo's level"


def test_equal_seeds_give_equal_lessons_and_progress_is_told(world):
    told = []
    first = collect(world, Lessons.SYNTHETIC, on_lesson=lambda *progress: told.append(progress))
    again = collect(world, Lessons.SYNTHETIC)
    assert all(torch.equal(a.pixels.color, b.pixels.color) for a, b in zip(first, again, strict=True))
    assert told[-1] == (len(world[2].train), len(world[2].train))


def test_maps_of_the_user_are_lit_with(world):
    plain, lit = (
        collect(world, Lessons.SYNTHETIC, environments=maps)
        for maps in ([], [Environment(patch_light((0.0, 0.0, 1.0)))])
    )
    assert any(not torch.equal(a.teacher, b.teacher) for a, b in zip(plain, lit, strict=True))


def test_a_scene_without_the_object_and_an_unknown_choice_are_refused(world):
    with pytest.raises(InputError, match="shows the reconstructed object"):
        collect_lessons(world[0], {}, world[2], CONFIG, CPU, 0)
    with pytest.raises(ConfigError, match="cannot be used"):
        DistillConfig.from_json({"lessons": "magic"})
    with pytest.raises(ConfigError, match="sphere_steps"):
        DistillConfig(sphere_steps=-1)

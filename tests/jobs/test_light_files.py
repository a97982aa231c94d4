"""Lights that runs are rendered under, from maps with and without their suns and lamps."""

import json
import math

import numpy as np
import pytest
import torch

from lightprobe.core.config.prediction import Sun
from lightprobe.core.errors import InputError
from lightprobe.export.light_file import write_sources
from lightprobe.jobs.light_files import scene_light, tell_of_scale, whole_light
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.files import light_file, other_map, write_map
from lightprobe.light.sources import LightSource
from lightprobe.models.calibration import Calibration

LAMPS = (
    LightSource((0.48, 0.6, 0.64), math.radians(6), (3.0, 2.4, 1.5)),
    LightSource((0.0, 0.0, -1.0), math.radians(20), (0.1, 0.2, 0.4)),
)


@pytest.fixture
def sky(tmp_path):
    path = tmp_path / "light.exr"
    Environment(torch.full((6, 32, 32, 3), 0.5)).save(path)
    return path


def irradiance(light: Environment, towards: tuple[float, float, float]) -> np.ndarray:
    """What a surface that faces one way receives, (3,)."""
    cosine = (cubemap.directions(light.resolution) @ torch.tensor(towards)).clamp(min=0)
    return (light.texels * (cosine * light.solid_angles())[..., None]).sum((0, 1, 2)).numpy()


def test_lamps_that_a_map_was_written_without_are_put_back(sky):
    bare = whole_light(sky)
    write_sources(sky, 64, LAMPS, Sun.SEPARATE)
    whole = whole_light(sky)
    for lamp in LAMPS:
        added = irradiance(whole, lamp.direction) - irradiance(bare, lamp.direction)
        assert added == pytest.approx(lamp.irradiance, rel=1e-3)


def test_lamps_that_are_in_the_map_are_not_added_again(sky):
    bare = whole_light(sky)
    write_sources(sky, 64, LAMPS, Sun.INSIDE)
    assert torch.equal(whole_light(sky).texels, bare.texels)


def test_a_light_file_of_something_else_is_named(sky):
    (sky.parent / "light.light.json").write_text("{}")
    with pytest.raises(InputError, match=r"light\.light\.json is no light file"):
        whole_light(sky)


def test_the_light_file_of_the_other_format_s_map_is_not_taken_for_this_one_s(sky):
    """NAME.exr and NAME.hdr share NAME.light.json, unless it says that they are the same map."""
    other, bare = sky.with_suffix(".hdr"), whole_light(sky)
    bare.save(other)
    write_sources(other, 64, LAMPS, Sun.SEPARATE)
    assert torch.equal(whole_light(sky).texels, bare.texels)
    assert not torch.allclose(whole_light(other).texels, Environment.load(other).texels)
    write_sources(other, 64, LAMPS, Sun.SEPARATE, copies=[sky.name])
    assert not torch.equal(whole_light(sky).texels, bare.texels)
    renamed = sky.rename(sky.with_name("renamed.exr"))  # together with its light file
    sky.with_name("light.light.json").rename(sky.with_name("renamed.light.json"))
    assert not torch.equal(whole_light(renamed).texels, bare.texels)


def test_whose_light_file_would_be_replaced(sky):
    other = sky.with_suffix(".hdr")
    assert other_map(sky) is None
    write_sources(other, 64, LAMPS, Sun.SEPARATE)
    assert other_map(sky) is None  # that map is not there
    Environment.load(sky).save(other)
    write_sources(other, 64, LAMPS, Sun.SEPARATE)
    assert other_map(sky) == other
    assert other_map(other) is None


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"map": 3}', '{"map": {"file": 7}}', '{"map": {"file": "a/../x\\u0000"}}']
)
def test_a_damaged_light_file_is_nobody_s(sky, text):
    """It is replaced with the map: a prediction must not be lost for it."""
    light_file(sky).write_text(text)
    assert other_map(sky) is None


def flux(image: np.ndarray) -> float:
    """The radiance of a map over the sphere."""
    light = Environment.from_panorama(image, 64)
    return float((light.texels * light.solid_angles()[..., None]).sum())


@pytest.mark.parametrize("rows", [64, pytest.param(512, marks=pytest.mark.long)])
def test_a_sharp_sun_is_either_a_lamp_or_in_the_map(tmp_path, rows):
    """The sun is one pixel, which the search for sources sees as part of a texel."""
    image = np.full((rows, 2 * rows, 3), 0.5, np.float32)
    bare = flux(image)
    image[round(0.3 * rows), round(0.71 * rows)] += 0.1 * rows**2
    write_map(tmp_path / "light.exr", image)
    light = scene_light(tmp_path / "light.exr", Sun.SEPARATE)
    assert len(light.lamps) == 1
    assert flux(light.image) < 1.05 * bare
    assert flux(light.image) + sum(light.lamps[0].irradiance) == pytest.approx(flux(image), rel=0.01)
    assert np.array_equal(scene_light(tmp_path / "light.exr", Sun.INSIDE).image, image)


def test_lamps_of_a_light_file_are_those_found_in_its_map(tmp_path):
    """Its second lamp is nowhere in the map, and its third source of light no lamp of it: neither may come
    twice.
    """
    inside = LightSource((0.0, 0.6, 0.8), math.radians(6), (3.0, 2.4, 1.5))
    other = LightSource((0.6, -0.8, 0.0), math.radians(6), (4.0, 4.0, 4.0))
    texels = torch.full((6, 64, 64, 3), 0.1) + inside.texels(64) + other.texels(64)
    Environment(texels).save(tmp_path / "light.exr")
    fitted = LightSource((0.02, 0.6, 0.8), math.radians(5), (2.0, 2.0, 2.0))
    nowhere = LightSource((0.0, 0.0, -1.0), math.radians(6), (9.0, 9.0, 9.0))
    write_sources(tmp_path / "light.exr", 128, (nowhere, fitted), Sun.INSIDE)
    lamps = scene_light(tmp_path / "light.exr", Sun.SEPARATE).lamps
    assert sorted(lamp.irradiance[0] for lamp in lamps) == [2.0, pytest.approx(4.0, rel=0.05)]
    within = scene_light(tmp_path / "light.exr", Sun.INSIDE)
    assert not within.lamps
    assert [source.irradiance[0] for source in within.inside] == [9.0, 2.0]
    (tmp_path / "light.light.json").unlink()
    assert len(scene_light(tmp_path / "light.exr", Sun.INSIDE).inside) == 2


def test_a_lamp_that_is_found_as_two_comes_once(tmp_path):
    spots = [
        LightSource((math.sin(a), 0.0, math.cos(a)), math.radians(2), (3.0, 3.0, 3.0))
        for a in (-0.105, 0.105)
    ]
    texels = torch.full((6, 64, 64, 3), 0.05) + spots[0].texels(64) + spots[1].texels(64)
    Environment(texels).save(tmp_path / "light.exr")
    assert len(scene_light(tmp_path / "light.exr", Sun.SEPARATE).lamps) == 2
    whole = LightSource((0.0, 0.0, 1.0), math.radians(8), (6.0, 6.0, 6.0))
    write_sources(tmp_path / "light.exr", 128, (whole,), Sun.INSIDE)
    assert [one.irradiance[0] for one in scene_light(tmp_path / "light.exr", Sun.SEPARATE).lamps] == [6.0]


CALIBRATED = Calibration((2.0, 2.0, 2.0), "a grey card")


@pytest.mark.parametrize(
    ("told", "calibration", "words"),
    [
        (None, CALIBRATED, "without a calibration, and this run has one"),
        (CALIBRATED.to_json(), None, "with a calibration, and this run has none"),
        (None, None, None),
        (CALIBRATED.to_json(), CALIBRATED, None),
        ("nothing", CALIBRATED, None),  # a map from elsewhere
    ],
)
def test_a_map_of_before_a_calibration_is_told(sky, recwarn, told, calibration, words):
    write_sources(sky, 64, LAMPS, Sun.INSIDE)
    file = light_file(sky)
    if told != "nothing":
        file.write_text(json.dumps({**json.loads(file.read_text()), "calibration": told}))
    tell_of_scale(sky, calibration)
    said = [str(one.message) for one in recwarn]
    assert said == [] if words is None else words in said[0]

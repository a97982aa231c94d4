"""What counts as a dominant light, and how photos are summed up."""

import math

import pytest
import torch

import measure_sources
from lightprobe.light.environment import Environment
from lightprobe.light.sources import LightSource
from measure_sources import Measured


def lamp(direction, irradiance: float, radius: float = 6.0) -> LightSource:
    return LightSource(direction, math.radians(radius), (irradiance,) * 3)


def light(*lamps: LightSource) -> Environment:
    return Environment(torch.full((6, 32, 32, 3), 0.2) + sum(one.texels(32) for one in lamps))


def test_a_light_is_dominant_without_a_rival_only():
    strong, weak = lamp((1.0, 0.0, 0.0), 3.0), lamp((0.0, 1.0, 0.0), 1.0)
    found = measure_sources.dominant(light(strong, weak))
    assert measure_sources.apart(found, strong) < 1
    assert measure_sources.dominant(light(strong, lamp((0.0, 1.0, 0.0), 2.0))) is None
    assert measure_sources.dominant(light(lamp((1.0, 0.0, 0.0), 0.5))) is None
    assert measure_sources.dominant(light(lamp((1.0, 0.0, 0.0), 9.0, radius=40))) is None


def test_medians_count_a_photo_without_a_source_as_a_miss():
    good = Measured("run", "a", 4.0, 2.0, 0.5, 0.9, 0.2, 3.0)
    missed = Measured("run", "b", None, None, None, None, None, None)
    told = measure_sources.summary([good, good, missed])
    assert told["photos"] == 3
    assert (told["degrees"], told["map_degrees"]) == (2.0, 4.0)
    assert (told["irradiance_error"], told["map_irradiance_error"]) == pytest.approx((0.1, 0.5))
    assert told["within_one_deviation"] == 1.0
    assert measure_sources.summary([missed])["degrees"] == 180.0


def test_no_run_is_a_sentence(tmp_path):
    with pytest.raises(SystemExit, match="is not a run folder"):
        measure_sources.main([str(tmp_path)])

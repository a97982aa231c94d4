"""Maps of a video's frames: steadied together with their sources."""

import math

import pytest
import torch

from lightprobe.jobs.job import _steady
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.sources import LightSource, SplitLight, split_light
from lightprobe.prediction import Prediction
from lightprobe.prediction.verdict import PhotoVerdict

GOOD = PhotoVerdict(0.01, 0.99, 0.99, 0.0, 0.2, 0.99, 0.0)
LAMP = LightSource((0.0, 0.6, 0.8), math.radians(6), (2.0, 2.0, 2.0))


def test_the_sources_of_a_frame_are_those_of_its_steadied_map():
    """A lamp that the frame's own map shows too dimly to be found."""
    sky = torch.full((6, 32, 32, 3), 0.3)
    frame = Environment(sky)
    own = Prediction(frame, torch.ones(6, 32, 32), {}, GOOD, split=SplitLight(frame, ()))
    steady = Environment(sky + LAMP.texels(32))
    split = _steady(own, steady).split
    assert split.sources == split_light(steady).sources != ()
    received = cubemap.directions(32)[..., 2:].clamp(min=0) * cubemap.solid_angles(32)[..., None]
    whole = split.rest.texels + sum(source.texels(32) for source in split.sources)
    assert float((whole * received).sum()) == pytest.approx(float((steady.texels * received).sum()), rel=0.02)

"""The brightness that light and base colour share is found again from the photo of a glossy ball."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.decompose.gauge import choose_brightness
from lightprobe.decompose.lights import Lights
from lightprobe.decompose.photos import Target
from lightprobe.light.prefilter import cached
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import View
from tests.render.test_split_sum import sky, sphere_gbuffer
from tests.shapes import camera_at

CPU = torch.device("cpu")


@pytest.mark.parametrize(("off", "expected"), [(2.0, (0.5, 0.85)), (0.5, (1.2, 2.0)), (1.0, (0.85, 1.2))])
def test_brightness_moves_towards_the_truth(off, expected):
    true = sphere_gbuffer(1500, roughness=0.25, base=(0.3, 0.25, 0.2))
    config = DecomposeConfig()
    operator = cached(config.light_resolution)
    light = 0.5 * sky(config.light_resolution).clamp(max=3)
    photo = shade(true, operator, operator.apply(light))
    target = Target("ball", View.of(camera_at([3, 0, 0.1]), CPU), photo, torch.ones(1500))
    lights = Lights(["ball"], config, CPU, 0)
    lights.maps = [light / off]  # as it is solved for the wrong surface
    wrong = replace(true, base_color=true.base_color * off)
    factor = choose_brightness(lambda _: wrong, [target], lights, config, 0)
    assert expected[0] <= factor <= expected[1], factor
    assert np.isclose(factor, choose_brightness(lambda _: wrong, [target], lights, config, 0))

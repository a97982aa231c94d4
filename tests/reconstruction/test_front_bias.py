"""Lights that know where the camera stands: under a wrong brightness, on a turntable, and in photographers'
habits.
"""

import math
from dataclasses import replace

import pytest
import torch
from lightprobe.reconstruction.front_bias import FrontBias

from lightprobe.core.config import DecomposeConfig
from lightprobe.light.prefilter import cached
from lightprobe.light.resize import rotate_light
from lightprobe.reconstruction.lights import solve_target_light
from lightprobe.render.split_sum import shade
from tests.gbuffers import R, sky, sphere_gbuffer, turned

CONFIG = DecomposeConfig()
FRONT = torch.tensor([1.0, 0.0, 0.0])
UP = torch.tensor([0.0, 0.0, 1.0])


def skies(angles):
    return [rotate_light(sky(R), turned(angle), R) for angle in angles]


def around(count):
    """Angles of `count` lights, evenly all around."""
    return [2 * math.pi * (k + 0.17) / count for k in range(count)]


def test_lights_from_all_sides_are_likely():
    bias = FrontBias.of(skies(around(12)), [FRONT] * 12, UP)
    assert abs(bias.mean) < 0.02
    assert bias.surprise < 0.1


def test_lights_from_behind_are_less_likely_than_lights_from_the_front():
    spread = [
        math.atan2(0.4, 0.6) + 0.9 * math.sin(5 * k) for k in range(16)
    ]  # suns in front, up to 52 degrees off
    front, behind = (
        FrontBias.of(skies([a - side for a in spread]), [FRONT] * 16, UP) for side in (0.0, math.pi)
    )
    assert front.mean == pytest.approx(-behind.mean, abs=0.02)
    assert front.mean > 0.3
    assert 1 < front.surprise < 3 < behind.surprise


def test_it_is_the_camera_s_side_whatever_the_frame():
    angles = [0.3 * k for k in range(8)]
    bias = FrontBias.of(skies(angles), [FRONT] * 8, UP)
    shifted = FrontBias.of(
        skies([a + 1.0 for a in angles]), [2 * turned(-1.0) @ FRONT + torch.tensor([0, 0, 3.0])] * 8, UP
    )
    assert shifted.mean == pytest.approx(bias.mean, abs=0.02)
    assert shifted.error == pytest.approx(bias.error, rel=0.05)


def test_up_need_not_be_z():
    """As in the frames of programs whose y axis points down: light from above comes from neither side there,
    too.
    """
    down = torch.tensor(
        [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    )  # takes such a frame to one with z up
    angles, towards = [0.3 * k for k in range(8)], [FRONT + 0.1 * k * UP for k in range(8)]
    bias = FrontBias.of(skies(angles), towards, UP)
    fallen = FrontBias.of(
        [rotate_light(s, down, R) for s in skies(angles)], [at @ down for at in towards], UP @ down
    )
    assert fallen.mean == pytest.approx(bias.mean, abs=0.02)
    assert fallen.error == pytest.approx(bias.error, rel=0.05)


def test_photos_of_one_light_as_the_camera_sees_it_count_as_one():
    turntable = FrontBias.of(skies([math.pi] * 32), [FRONT] * 32, UP)
    assert turntable.mean < -0.2
    assert turntable.error == pytest.approx(0.3, rel=0.02)
    assert turntable.surprise < 2


def test_few_photos_or_none_from_the_side_say_nothing():
    assert FrontBias.of(skies(around(7)), [FRONT] * 7, UP) is None
    assert FrontBias.of(skies(around(9)), [FRONT] * 7 + [UP] * 2, UP) is None


@pytest.mark.slow
@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_a_surface_taken_for_too_bright_asks_for_light_from_behind(metallic):
    ball = sphere_gbuffer(800, roughness=0.3, metallic=metallic, base=(0.05, 0.05, 0.05))
    operator, biases = cached(CONFIG.light_resolution), []
    lights = [0.5 * rotate_light(sky(R), turned(angle), CONFIG.light_resolution) for angle in around(8)]
    for factor in (1.0, 8.0):
        taken, found = replace(ball, base_color=ball.base_color * factor), []
        for light in lights:
            photo = shade(ball, operator, operator.apply(light))
            grey, rows = torch.full_like(light, 0.5 / factor), torch.arange(len(photo))
            found.append(
                solve_target_light(photo, torch.zeros_like(photo).bool(), taken, grey, rows, CONFIG, 3)
            )
        biases.append(FrontBias.of(found, [FRONT] * 8, UP))
    right, wrong = biases
    assert abs(right.mean) < 0.1
    assert wrong.mean < right.mean - 0.15

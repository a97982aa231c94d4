import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from lightprobe.core.config.prediction import OptimizeConfig, refinement
from lightprobe.core.errors import ConfigError
from lightprobe.light import cubemap
from lightprobe.light.photometry import displayed_error
from lightprobe.light.prefilter import cached
from lightprobe.prediction.observation import observe
from lightprobe.prediction.optimize import _batches, refine_environment
from lightprobe.render.transport import Transport
from lightprobe.training import descent
from tests.lit_sphere import CORNER, corner, glossy_sphere, patch_light, photograph
from tests.tape import compute_as_a_gpu_does, record_on_tape

CPU = torch.device("cpu")


def test_directions_the_photo_says_nothing_about_stay():
    observation, facing = corner()
    prior = observation.light_level.expand(6, 16, 16, 3).contiguous()
    behind = cubemap.directions(16) @ torch.nn.functional.normalize(facing, dim=0) < -0.3
    moved = {}
    for damping in (0.0, refinement().damping):
        light = refine_environment(observation, prior, replace(refinement(), damping=damping), seed=0)
        change = (light / prior).log().abs().mean(-1)
        moved[damping] = float(change[behind].mean() / change[~behind].mean())
    assert moved[refinement().damping] < 0.5 * moved[0.0]


def test_the_smooth_part_moves_what_single_texels_hardly_would():
    observation, facing = corner()
    prior = observation.light_level.expand(6, 16, 16, 3).contiguous()
    ahead = cubemap.directions(16) @ torch.nn.functional.normalize(facing, dim=0) > 0.5
    moved = {}
    for rate in (0.0, 0.2):
        config = replace(refinement(), iterations=10, learning_rate=1e-3, smooth_learning_rate=rate)
        light = refine_environment(observation, prior, config, seed=0)
        moved[rate] = float((light / prior).log().abs()[ahead].mean())
    assert moved[0.2] > 10 * moved[0.0]


def test_the_broad_part_brings_the_whole_light_to_its_brightness():
    """From a light half as bright as it should be, in steps too few for the damped parts alone."""
    asset, light = glossy_sphere(), patch_light((0.2, 1.0, 0.5))
    observation = observe(asset, photograph(asset, CORNER, light), CORNER, CPU, 65_536)
    start, off = (0.5 * light).contiguous(), {}
    for damping in (refinement().broad_damping, 1e6):
        config = replace(refinement(), iterations=20, broad_damping=damping)
        found = refine_environment(observation, start, config, seed=0)
        off[damping] = float((found / light).log().abs().mean())
    assert off[refinement().broad_damping] < 0.7 * off[1e6]


@pytest.mark.slow
def test_recorded_steps_go_where_single_ones_do(monkeypatch):
    compute_as_a_gpu_does(monkeypatch)
    observation, _ = corner()
    prior = observation.light_level.expand(6, 4, 4, 3).contiguous()
    config = replace(refinement(), iterations=12)

    single = refine_environment(observation, prior, config, seed=0)
    recorders = record_on_tape(monkeypatch, descent)
    recorded = refine_environment(observation, prior, config, seed=0)
    assert [recorder.replays for recorder in recorders] == [9]
    assert float((single / prior).log().abs().mean()) > 0.01
    assert torch.allclose(recorded, single, rtol=1e-3)


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.filterwarnings("error:Steps cannot be recorded", "error:The CUDA Graph is empty")
def test_a_gpu_refines_from_a_recording_as_it_does_step_by_step(monkeypatch):
    observation, _ = corner(torch.device("cuda", 0))
    prior = observation.light_level.expand(6, 16, 16, 3).contiguous()
    recorded = refine_environment(observation, prior, refinement(), seed=0)
    monkeypatch.setattr(descent, "recorder_for", lambda device: None)
    single = refine_environment(observation, prior, refinement(), seed=0)
    assert float((recorded / single).log().norm()) < 0.01 * float((single / prior).log().norm())


@pytest.mark.long
def test_a_refinement_in_a_new_process_loads_no_compiler():
    """PyTorch's costs it two seconds."""
    code = """
import sys, torch
from lightprobe.core.config.prediction import refinement
from lightprobe.prediction.optimize import refine_environment
from tests.lit_sphere import corner
observation, _ = corner()
refine_environment(observation, observation.light_level.expand(6, 4, 4, 3).contiguous(), refinement(), seed=0)
sys.exit("torch._dynamo" in sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[2], check=True)


@pytest.mark.parametrize("count", [7, 256, 1000, 3072])
def test_batches_are_of_one_size_and_share_no_pixel(count):
    batches = _batches(count, 256, CPU)
    assert len({len(rows) for rows in batches}) == 1
    every = torch.cat(batches)
    assert len(every.unique()) == len(every) > count - len(batches)
    assert len(batches) == max(1, round(count / 256))
    assert [rows.tolist() for rows in _batches(count, 0, CPU)] == [list(range(count))]


@pytest.mark.slow
def test_steps_on_batches_explain_the_photo_as_steps_on_all_pixels_do():
    asset = glossy_sphere()
    observation = observe(asset, photograph(asset, CORNER, patch_light((0.2, 1.0, 0.5))), CORNER, CPU, 65_536)
    prior = observation.light_level.expand(6, 16, 16, 3).contiguous()
    transport = Transport(observation.gbuffer, cached(16), observation.rows)

    def error(**changes):
        light = refine_environment(observation, prior, replace(refinement(), **changes), seed=0)
        return float(displayed_error(transport.apply(light), observation.pixels.color, observation.clipped))

    few = len(observation.rows) // 8
    together, in_turn, of_few = error(batch=0), error(batch=few), error(batch=0, pixels=few)
    assert in_turn < 1.5 * together
    assert in_turn < 0.8 * of_few


@pytest.mark.parametrize("name", ["smooth_learning_rate", "damping", "broad_damping", "grey", "batch"])
def test_negative_weights_are_refused(name):
    with pytest.raises(ConfigError, match="at least 0"):
        OptimizeConfig(**{name: -1})

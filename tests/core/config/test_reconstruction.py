"""What follows from Phase I's settings, which are refused, and what older runs stored."""

import dataclasses

import pytest

from lightprobe.core.config import DecomposeConfig, DistillConfig, Preset, StartShape, settings
from lightprobe.core.config.reconstruction import SdfMode
from lightprobe.core.errors import ConfigError


@pytest.mark.parametrize(("cells", "side"), [(8, 64), (63, 504), (64, 512), (128, 512)])
def test_depth_maps_are_as_fine_as_the_lattice_but_no_finer_than_usual(cells, side):
    assert DecomposeConfig(lattice_cells=cells).depth_map_side == side


def test_no_preset_has_coarse_depth_maps():
    shaded = [settings(preset).decompose for preset in Preset if settings(preset).decompose.shadows]
    assert {config.depth_map_side for config in shaded} == {512}


def test_the_small_paper_differs_from_the_paper_in_sizes_alone():
    small, paper = settings("paper-small"), settings("paper")
    differ = {}
    for section in ("decompose", "distill", "predict"):
        here, there = (vars(getattr(each, section)) for each in (small, paper))
        assert all(here[name] <= there[name] for name in here if here[name] != there[name])
        differ[section] = {name for name in here if here[name] != there[name]}
    assert differ == {
        "decompose": {
            "pass1_iterations",
            "pass2_iterations",
            "pass1_side",
            "pass2_side",
            "lattice_cells",
            "hash_log2_size",
            "hash_finest",
            "light_resolution",
            "texture_size",
            "unwrap_seconds",
            "checkpoint_every",
        },
        "distill": {"light_resolution", "max_side", "pixels_per_photo"},
        "predict": {"light_resolution"},
    }


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (DecomposeConfig, {"pass1_iterations": 0}, r"decompose\.pass1_iterations must be at least 1, not 0"),
        (DecomposeConfig, {"lattice_cells": 7}, "at least 8"),
        (DecomposeConfig, {"trial_steps": -1}, "at least 0"),
        (DecomposeConfig, {"coverage_weight": -0.5}, "0 or more and finite"),
        (DecomposeConfig, {"metallic_prior": float("nan")}, "0 or more and finite"),
        (DecomposeConfig, {"teacher_resolution": 24}, "power of two from 8 to 256, not 24"),
        (DecomposeConfig, {"adam_decay": 1.0}, "below 1"),
        (DecomposeConfig, {"start": StartShape.RANDOM, "sdf": SdfMode.MLP}, "cannot hold noise"),
        (DistillConfig, {"sphere_steps": -1}, r"distill\.sphere_steps must be at least 0"),
        (DistillConfig, {"light_resolution": 4}, "power of two"),
    ],
)
def test_values_that_no_run_could_use_are_refused(kind, values, words):
    with pytest.raises(ConfigError, match=words):
        kind(**values)


def test_settings_that_are_constants_today_are_passed_over_in_older_runs():
    old = {**dataclasses.asdict(DecomposeConfig()), "normal_prior_detail": 0.0, "sdf_coarse_grids": 2}
    assert DecomposeConfig.from_json(old) == DecomposeConfig()
    assert DistillConfig.from_json({"sphere_batch": 8, "frequencies": 3}) == DistillConfig()
    with pytest.raises(ConfigError, match="no setting 'normal_prior_details'"):
        DecomposeConfig.from_json({"normal_prior_details": 0.0})

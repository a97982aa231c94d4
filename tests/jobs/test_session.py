"""Runs stay loaded until others need the room, and are loaded anew when their files change."""

import os
import shutil

import pytest
import torch

from lightprobe.core.run import RunFolder
from lightprobe.jobs import Sessions
from lightprobe.models import LightAccuracy
from tests.view.finished_run import finished_run

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Three equal runs."""
    folder = tmp_path_factory.mktemp("loaded")
    first = finished_run(folder)
    copies = [RunFolder(folder / name) for name in ("second", "third")]
    for copy in copies:
        shutil.copytree(first.path, copy.path)
    return [first, *copies]


@pytest.mark.slow
def test_the_least_recently_used_goes(runs):
    loaded = Sessions(CPU, memory=1)
    one = loaded.get(runs[0].path)
    size = loaded.trim()
    assert size > 100_000
    assert loaded.get(runs[0].path) is one
    loaded = Sessions(CPU, memory=int(2.5 * size))
    for run in (runs[0], runs[1], runs[0], runs[2]):
        loaded.get(run.path)
        loaded.trim()
    assert loaded.paths == (str(runs[0].path), str(runs[2].path))
    assert (loaded.loads, loaded.evictions) == (3, 1)


def test_no_more_than_are_wanted(runs):
    loaded = Sessions(CPU, most=1)
    for run in runs:
        loaded.get(run.path)
        assert loaded.paths == (str(run.path),)


def test_a_run_that_has_changed_is_loaded_anew(runs):
    loaded = Sessions(CPU)
    before = loaded.get(runs[1].path)
    os.utime(runs[1].asset_file, (1, 1))
    os.utime(runs[1].config_file)
    assert loaded.get(runs[1].path) is not before
    assert len(loaded.paths) == 1


def test_a_run_whose_light_accuracy_has_come_is_loaded_anew(runs):
    loaded = Sessions(CPU)
    assert loaded.get(runs[1].path).predictor.accuracy is None
    LightAccuracy("probe-net", 16, 0.5, (0.1, 0.2, 0.6), 0.8, 0.9).save(runs[1].model_folder)
    assert loaded.get(runs[1].path).predictor.accuracy is not None

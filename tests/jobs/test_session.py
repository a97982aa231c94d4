"""Runs stay loaded until others need the room, and are loaded anew when their files change."""

import os
import shutil

import pytest
import torch
from lightprobe.runs.loaded import LoadedRuns
from lightprobe.runs.locations import LocationFiles
from lightprobe.runs.new_photos import PhotoFiles

from lightprobe.core.run import RunFolder
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
    loaded = LoadedRuns(CPU, memory=1)
    one = loaded.get(runs[0])
    size = loaded.trim()
    assert size > 100_000
    assert loaded.get(runs[0]) is one
    loaded = LoadedRuns(CPU, memory=int(2.5 * size))
    for run in (runs[0], runs[1], runs[0], runs[2]):
        loaded.get(run)
        loaded.trim()
    assert loaded.paths == (str(runs[0].path), str(runs[2].path))
    assert (loaded.loads, loaded.evictions) == (3, 1)


def test_no_more_than_are_wanted(runs):
    loaded = LoadedRuns(CPU, most=1)
    for run in runs:
        loaded.get(run)
        assert loaded.paths == (str(run.path),)


def test_a_run_that_has_changed_is_loaded_anew(runs):
    loaded = LoadedRuns(CPU)
    before = loaded.get(runs[1])
    os.utime(runs[1].asset_file, (1, 1))
    os.utime(runs[1].config_file)
    assert loaded.get(runs[1]) is not before
    assert len(loaded.paths) == 1


def test_a_run_whose_light_accuracy_has_come_is_loaded_anew(runs):
    loaded = LoadedRuns(CPU)
    assert loaded.get(runs[1]).predictor.accuracy is None
    LightAccuracy("probe-net", 16, 0.5, (0.1, 0.2, 0.6), 0.8, 0.9).save(runs[1].model_folder)
    assert loaded.get(runs[1]).predictor.accuracy is not None


def test_the_scenes_own_photo_needs_no_camera_under_any_name(runs, tmp_path):
    scene = runs[0].path.parent / "scene"
    photo = shutil.copy(scene / "test" / "test_00.png", tmp_path / "upload.png")
    found = LocationFiles(*(tmp_path / name for name in ("camera.json", "mask.png", "overlay.png")))
    read = LoadedRuns(CPU).get(runs[0]).read(PhotoFiles(tmp_path / "upload.png", None, found))
    assert photo
    assert read.location is None
    assert read.camera.to_json() == runs[0].scene()["photos"]["test"]["test_00"]["camera"]

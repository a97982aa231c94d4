"""What a training keeps beside object and networks: views for locating new photos, and what its maps come to."""

import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch

from lightprobe.core.config import DistillConfig
from lightprobe.core.config.prediction import PredictConfig
from lightprobe.core.errors import ConvergenceError, ResourceError
from lightprobe.core.run import RunFolder
from lightprobe.light.environment import Environment
from lightprobe.localization import KnownViews
from lightprobe.models import Decomposition, LightAccuracy, ProbeModel
from lightprobe.models.calibration import Calibration
from lightprobe.models.probe_model import new_network, new_sphere
from lightprobe.runs.phases import (
    TRAINED,
    is_learnt,
    keep_accuracy,
    keep_views,
    restart_decompose,
    restart_distill,
)
from lightprobe.runs.progress import silent
from lightprobe.scene import load_scene
from lightprobe.scene.record import scene_record
from tests.painted_object import SIMILARITY, painted_asset, painted_scene
from tests.toy_scene import write_toy_scene


@pytest.fixture(scope="module")
def learnt(tmp_path_factory):
    asset = painted_asset()
    lights = {"light": Environment(torch.ones(6, 8, 8, 3))}
    return Decomposition(asset, lights, SIMILARITY), painted_scene(tmp_path_factory.mktemp("scene"), asset)


@pytest.mark.slow
def test_a_training_keeps_the_views_once(learnt, tmp_path):
    run, told = RunFolder.create(tmp_path / "run"), []
    keep_views(run, *learnt, lambda stage, done, total, note="": told.append((stage, done, total)))
    assert told[-1] == ("views", 8, 8)
    assert len(KnownViews.load(run.views_file).landmarks.point) > 100
    before = run.views_file.stat().st_mtime_ns
    keep_views(run, *learnt, silent)
    assert run.views_file.stat().st_mtime_ns == before


def test_without_opencv_a_training_ends_well_and_says_so_in_its_log(learnt, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    run = RunFolder.create(tmp_path / "run")
    keep_views(run, *learnt, silent)
    assert not run.views_file.exists()
    assert "pip install 'lightprobe[photos]'" in run.log_file.read_text()


def test_tiny_photos_have_no_features_to_keep(learnt, tmp_path):
    run = RunFolder.create(tmp_path / "run")
    keep_views(run, learnt[0], load_scene(write_toy_scene(tmp_path / "toy", train=2, test=1)), silent)
    assert not run.views_file.exists()


@pytest.fixture(scope="module")
def small_model():
    config = replace(
        DistillConfig(), light_resolution=8, width=16, depth=2, sphere_width=4, simulated_photos=2
    )
    light, up = Environment(torch.ones(6, 8, 8, 3)), torch.tensor([0.0, 0.0, 1.0])
    return ProbeModel(new_network(config), light, up, config, new_sphere(config))


def begun(learnt, model: ProbeModel, folder: Path) -> RunFolder:
    """Return a run whose Phase II has just left its networks."""
    run = RunFolder.create(folder)
    run.record_scene(scene_record(learnt[1]))
    run.record_config("distill", asdict(model.config))
    model.save(run.model_folder)
    return run


def keep(run: RunFolder, learnt, model: ProbeModel) -> None:
    keep_accuracy(run, learnt[0], model, PredictConfig(light_resolution=8), torch.device("cpu"), 0, silent)


@pytest.mark.slow
def test_a_training_is_finished_once_its_simulated_photos_are_predicted(learnt, small_model, tmp_path):
    run = begun(learnt, small_model, tmp_path / "run")
    assert not is_learnt(run)
    keep(run, learnt, small_model)
    assert LightAccuracy.load(run.model_folder).photos == 2
    assert is_learnt(run)
    assert "simulated photos predicted in" in run.log_file.read_text()


def test_without_simulated_photos_nothing_is_measured(learnt, small_model, tmp_path):
    without = replace(small_model, config=replace(small_model.config, simulated_photos=0))
    run = begun(learnt, without, tmp_path / "run")
    assert is_learnt(run)
    keep(run, learnt, without)
    assert not LightAccuracy.is_decided(run.model_folder)


def test_a_run_that_starts_over_forgets_the_calibration_of_its_old_object(learnt, small_model, tmp_path):
    run = begun(learnt, small_model, tmp_path / "run")
    Calibration((3.0, 3.0, 3.0), "a card").save(run.calibration_file)
    (run.path / TRAINED).touch()
    restart_distill(run)
    assert not (run.path / TRAINED).exists()  # another commit may train it now
    assert run.calibration_file.is_file()  # the object is the same
    restart_decompose(run)
    assert not run.calibration_file.exists()


def no_map(*_, **__):
    raise ConvergenceError("The map is not finite.")


def no_memory(*_, **__):
    raise ResourceError("Out of memory.")


@pytest.mark.parametrize(
    ("simulate", "told", "finished"),
    [
        (no_map, "The map is not finite.", True),  # so that nobody tries for ever
        (lambda *_, **__: None, "No camera of a training photo shows the object.", True),
        (no_memory, "Out of memory.", False),  # there may be some the next time
    ],
)
def test_photos_that_cannot_be_simulated_fail_no_training(
    learnt, small_model, tmp_path, monkeypatch, simulate, told, finished
):
    monkeypatch.setattr("lightprobe.runs.phases.light_accuracy", simulate)
    run = begun(learnt, small_model, tmp_path / "run")
    keep(run, learnt, small_model)
    assert LightAccuracy.load(run.model_folder) is None
    assert is_learnt(run) is finished
    assert f"could not be simulated. {told}" in run.log_file.read_text()

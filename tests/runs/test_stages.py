"""What a training keeps for locating new photos."""

import sys

import pytest
import torch

from lightprobe.core.run import RunFolder
from lightprobe.light.environment import Environment
from lightprobe.localization import KnownViews
from lightprobe.models import Decomposition
from lightprobe.runs.progress import silent
from lightprobe.runs.stages import keep_views
from lightprobe.scene import load_scene
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

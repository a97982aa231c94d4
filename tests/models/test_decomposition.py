"""A decomposition and its files in a run."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.run import RunFolder
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition, ObjectVerdict
from lightprobe.scene.record import scene_record
from tests.known_scene import CPU, known_scene


@pytest.mark.parametrize("verdict", [None, ObjectVerdict(0.05, 4)])
def test_the_verdict_comes_back_with_the_object(tmp_path, verdict):
    true, scene = known_scene(tmp_path)
    run = RunFolder.create(tmp_path / "run")
    run.record_scene(scene_record(scene))
    lights = {photo.name: Environment(torch.ones(6, 16, 16, 3)) for photo in scene.train}
    replace(true, lights=lights, verdict=verdict).save(run)
    assert Decomposition.load(run, CPU).verdict == verdict

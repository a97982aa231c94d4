"""The object of an unfinished training is that of its newest checkpoint."""

import numpy as np
import pytest
import torch

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.errors import InputError
from lightprobe.reconstruction import decompose
from lightprobe.reconstruction.checkpoint_preview import CheckpointPreview
from lightprobe.scene import load_scene
from lightprobe.training import Progress
from tests.toy_scene import write_toy_scene
from tests.view.finished_run import SETTINGS


class EnoughError(Exception):
    """Ends a training in the middle."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return load_scene(write_toy_scene(tmp_path_factory.mktemp("toy"), train=12, test=1))


def interrupted(scene, folder, stage, step):
    """Return the newest checkpoint of a training that ended after a step of a stage."""
    checkpoints = Checkpoints(folder)

    def on_step(name, done, steps, loss):
        if (name, done) == (stage, step):
            raise EnoughError

    with pytest.raises(EnoughError):
        decompose(scene, SETTINGS, progress=Progress(checkpoints, on_step))
    _, tensors, state = checkpoints.latest()
    return tensors, state


@pytest.mark.slow
@pytest.mark.parametrize(("stage", "step"), [("pass1", 3), ("pass2", 3)])
def test_a_checkpoint_shows_its_surface(scene, tmp_path, stage, step):
    tensors, state = interrupted(scene, tmp_path, stage, step)
    assert state["stage"] == stage
    forming = CheckpointPreview(scene, torch.device("cpu"))
    surface = forming.surface(tensors, state)
    radius = scene.similarity.scale * surface.vertices.norm(dim=1)
    assert surface.stage == stage
    assert np.median(radius) == pytest.approx(1, abs=0.25)  # the toy scene's ball
    assert surface.color.shape == surface.vertices.shape
    assert 0 < surface.color.mean() < 1
    assert int(surface.faces.max()) < len(surface.vertices)
    if stage == "pass2":  # the first checkpoint of a later pass holds only what it starts from
        start = forming.surface(tensors, {**state, "iteration": 0})
        assert not torch.equal(start.vertices, surface.vertices)


def test_a_checkpoint_of_something_else_is_refused(scene):
    with pytest.raises(InputError, match="does not fit"):
        CheckpointPreview(scene, torch.device("cpu")).surface({}, {"config": {}, "stage": "pass2", "seed": 0})

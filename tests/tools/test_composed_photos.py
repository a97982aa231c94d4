"""Photos of an object in front of the environment that lights it."""

import json

import numpy as np
import pytest

from composed_photos import write_opaque_scene
from lightprobe.imaging import read_ldr, read_mask, write_exr
from lightprobe.scene import load_scene
from lightprobe.scene.background import load_background
from tests.toy_scene import write_toy_scene


@pytest.fixture
def scene(tmp_path):
    """The toy scene, its training photos under known lights that are grey."""
    folder = write_toy_scene(tmp_path / "scene")
    file = folder / "transforms_train.json"
    told = json.loads(file.read_text())
    for frame in told["frames"]:
        frame["env_path"] = "env.exr"
    file.write_text(json.dumps(told))
    write_exr(folder / "env.exr", np.full((8, 16, 3), 0.25, np.float32))
    return folder


@pytest.mark.slow
def test_training_photos_become_opaque_and_keep_their_masks(scene, tmp_path):
    before = load_scene(scene).train
    assert all(load_background(photo) is None for photo in before)
    assert len(write_opaque_scene(scene, tmp_path / "opaque")) == len(before)
    for old, new in zip(before, load_scene(tmp_path / "opaque").train, strict=True):
        shown = load_background(new)
        np.testing.assert_allclose(shown.color[shown.seen], 0.25, atol=0.01)
        color, alpha = read_ldr(old.image_path)
        np.testing.assert_allclose(read_mask(new.mask_path), alpha, atol=0.01)
        np.testing.assert_allclose(read_ldr(new.image_path)[0][alpha == 1], color[alpha == 1], atol=0.01)

"""A trained run that the tests of the commands share."""

import shutil

import pytest

from lightprobe.core.run import RunFolder
from tests.cli.commands import succeed
from tests.toy_scene import TINY_DISTILL, TINY_WITHOUT_TRIALS, write_toy_scene


@pytest.fixture(scope="session")
def toy_run(tmp_path_factory):
    """A scene folder and a run on it, trained for a few steps; the run is not to be changed."""
    folder = tmp_path_factory.mktemp("toy")
    scene = write_toy_scene(folder / "scene")
    succeed("train", scene, "-o", folder / "run", *TINY_WITHOUT_TRIALS, *TINY_DISTILL)
    return scene, RunFolder(folder / "run")


@pytest.fixture(scope="module")
def trained(toy_run, tmp_path_factory):
    """The scene, and a copy of the run that the module's tests may evaluate, predict with and train on."""
    scene, run = toy_run
    return scene, RunFolder(shutil.copytree(run.path, tmp_path_factory.mktemp("copy") / "run"))

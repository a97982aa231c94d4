"""Phase II by processes that torchrun starts: the same networks, one writer, and one sentence where one dies."""

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from lightprobe.cli.main import main
from lightprobe.cli.training import demo, fit, train
from lightprobe.core.checkpoint import load_tensors
from lightprobe.core.ending import LOST
from lightprobe.core.errors import ConfigError
from lightprobe.core.run import RunFolder
from tests.cli.commands import succeed
from tests.toy_scene import TINY_DISTILL, changed

OPTIONS = [
    *changed(TINY_DISTILL, samples=65, sphere_batch=3),
    "--device",
    "cpu",
    "--restart",
]  # odd: uneven halves
ROUNDING = 1e-6  # of a weight; one step moves it by as much as 5e-4
# Exchanges of a process before the steps: after recording the options, opening the scene and finding
# checkpoints two each; a step of the first stage takes two. After 5 steps of 12 there is a checkpoint.
KILLED = 2 + 2 + 2 + 2 * 8


def torchrun(run: Path, killed: int, options: list[str]) -> subprocess.CompletedProcess[str]:
    """Start two processes of `distill`, of which the second writes nothing and is killed after some
    exchanges.
    """
    starter = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    program = [str(Path(__file__).with_name("watched_program.py")), str(run), str(killed)]
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    command = [*starter, *program, "distill", str(run), *options]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300)


def weights(run: RunFolder) -> dict[str, torch.Tensor]:
    files = (run.model_folder / name for name in ("illumination_mlp.safetensors", "sphere_net.safetensors"))
    return {f"{path.name}/{name}": value for path in files for name, value in load_tensors(path).items()}


def files(run: RunFolder) -> set[str]:
    return {str(path.relative_to(run.path)) for path in run.path.rglob("*")}


@pytest.mark.long
def test_two_processes_learn_what_one_learns_also_after_one_was_killed(trained, tmp_path):
    one, two = trained[1], RunFolder(shutil.copytree(trained[1].path, tmp_path / "two"))
    succeed("distill", one.path, *OPTIONS)
    killed = torchrun(two.path, KILLED, OPTIONS)
    assert killed.returncode != 0
    told = [line for line in killed.stderr.splitlines() if line.startswith("lightprobe: ")]
    assert told == [f"lightprobe: {LOST}"], killed.stderr
    assert killed.stdout == ""
    assert two.model_checkpoints.newest_step() == 5
    assert not (two.model_folder / "config.json").exists()
    ended = torchrun(two.path, 0, OPTIONS[:-1])
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.count("Model: ") == 1
    assert files(two) == files(one)
    expected, found = weights(one), weights(two)
    assert max(float((found[name] - value).abs().max()) for name, value in expected.items()) < ROUNDING
    log = two.log_file.read_text()
    assert log.count("distill goes on from step 5") == 1
    assert log.count("distill finished") == log.count("distill starts") == 2  # of the fixture, and ours


@pytest.mark.parametrize(
    "command", [lambda: train(Path(), output=Path()), lambda: fit(Path(), output=Path()), demo]
)
def test_only_phase_two_can_be_divided(command, monkeypatch):
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "test")
    monkeypatch.setenv("WORLD_SIZE", "2")
    with pytest.raises(ConfigError, match="run `lightprobe fit SCENE -o RUN` without torchrun"):
        command()


def test_the_other_processes_keep_their_answers(monkeypatch, capsys):
    monkeypatch.setattr("os._exit", lambda code: None)
    given = {"TORCHELASTIC_RUN_ID": "test", "WORLD_SIZE": "2", "RANK": "1"}
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    for rank, count in (("0", 1), ("1", 0)):
        monkeypatch.setenv("RANK", rank)
        main(["train", "nowhere", "-o", "no_run", "--json"])
        assert capsys.readouterr().out.count('"error"') == count


def test_the_package_is_the_program(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["lightprobe", "--version"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("lightprobe", run_name="__main__")
    assert ended.value.code == 0
    assert capsys.readouterr().out.strip()

"""The program on a toy scene: learn, go on, restart, find a scene that has moved."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from lightprobe.cli.main import COMMANDS, chosen_preset, main
from lightprobe.imaging import write_exr
from lightprobe.scene.camera import Camera
from tests.cli.commands import succeed
from tests.toy_scene import SIZE, TINY_DISTILL, TINY_WITHOUT_TRIALS, write_toy_scene


def test_training_leaves_the_documented_files(trained):
    _, run = trained
    files = {str(p.relative_to(run.path)) for p in run.path.rglob("*") if p.is_file()}
    names = {f"train_{i:02d}" for i in range(18)}
    assert {"config.json", "scene.json", "metrics.jsonl", "log.txt", "timings.json"} <= files
    assert {f"mesh/{n}" for n in ("object.glb", "base_color.png", "orm.png", "normal.png")} <= files
    assert {f"env/{name}.exr" for name in names} <= files
    assert {"model/config.json"} <= files
    steps = sorted(p.name for p in run.checkpoints.folder.iterdir())
    assert steps == ["step-000000025", "step-000000030"]
    assert not list(run.path.rglob(".partial-*"))
    lines = [json.loads(line) for line in run.metrics_log.read_text().splitlines()]
    assert [line["stage"] for line in lines if "loss" in line] == ["pass1", "pass2", "pass3", "distill"]
    assert [line["stage"] for line in lines if "held_out" in line] == ["pass2", "pass3"]


def test_the_same_command_again_changes_nothing(trained):
    scene, run = trained
    before = {p: p.read_bytes() for p in run.path.rglob("*") if p.is_file() and p.name != "log.txt"}
    succeed("train", scene, "-o", run.path, *TINY_WITHOUT_TRIALS, *TINY_DISTILL)
    assert {p: p.read_bytes() for p in run.path.rglob("*") if p.is_file() and p.name != "log.txt"} == before


@pytest.mark.slow
def test_another_scene_or_option_is_refused_with_the_difference(trained, tmp_path, capsys):
    scene, run = trained
    assert main(["fit", str(scene), "-o", str(run.path), *TINY_WITHOUT_TRIALS, "--seed", "3"]) == 3
    assert "decompose.seed = 0, not 3" in capsys.readouterr().err
    other = write_toy_scene(tmp_path / "other", train=5)
    assert main(["fit", str(other), "-o", str(run.path), *TINY_WITHOUT_TRIALS]) == 3
    assert "--restart" in capsys.readouterr().err


@pytest.mark.slow
def test_a_moved_scene_is_found_by_its_new_place(trained, tmp_path, capsys):
    scene, run = trained
    quickly = ("--no-unseen", "--methods", "constant")
    os.rename(scene, tmp_path / "moved")
    try:
        assert main(["eval", str(run.path)]) == 2
        assert "--scene" in capsys.readouterr().err
        succeed("eval", run.path, "--scene", tmp_path / "moved", *quickly)
    finally:
        os.rename(tmp_path / "moved", scene)
        succeed("eval", run.path, "--scene", scene, *quickly)


@pytest.mark.slow
def test_a_phase_can_be_restarted_with_other_options(trained, tmp_path):
    _, run = trained
    before = run.asset_file.read_bytes()
    short = [*TINY_DISTILL[2:], "--distill.steps", "3", "--device", "cpu"]
    assert main(["distill", str(run.path), *short]) == 3
    succeed("distill", run.path, "--restart", *short)
    assert run.config("distill")["steps"] == 3
    assert run.asset_file.read_bytes() == before
    maps = run.path.parent / "maps"
    write_exr(maps / "grey.exr", np.full((16, 32, 3), 0.5, np.float32))
    succeed("distill", run.path, "--restart", "--hdri", maps, *short)
    assert run.config("distill")["hdri"] == str(maps.resolve())
    succeed("distill", run.path, "--restart", *TINY_DISTILL, "--device", "cpu")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command_shows_an_example(command, capsys):
    with pytest.raises(SystemExit) as end:
        main([*command.split(), "--help"])
    assert end.value.code == 0
    assert f"lightprobe {command}" in capsys.readouterr().out.partition("Examples:")[2]


def test_commands_of_two_words_are_listed_and_a_wrong_one_is_told(capsys):
    assert main(["fleet", "--help"]) == 0
    assert "fleet predict" in capsys.readouterr().out
    assert main(["fleet", "pridect"]) == 2
    assert "no command 'fleet pridect'" in capsys.readouterr().err
    assert main(["fleet", "pridect", "--json"]) == 2
    assert "no command 'fleet pridect'" in json.loads(capsys.readouterr().out)["error"]
    assert main(["fleet"]) == 2


def test_the_last_preset_counts():
    assert chosen_preset(["scene"]) == "quick"
    assert chosen_preset(["--preset", "paper", "--preset=standard"]) == "standard"
    assert chosen_preset(["--preset=paper", "--preset", "quick"]) == "quick"


def test_help_shows_the_values_of_the_chosen_preset(capsys):
    with pytest.raises(SystemExit):
        main(["fit", "--help", "--preset", "paper"])
    assert "40000" in capsys.readouterr().out


def test_help_loads_no_torch():
    code = (
        "import sys; from lightprobe.cli.main import main; main(['--help']); sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


@pytest.mark.slow
def test_the_program_looks_for_garbage_in_what_a_command_makes_alone():
    code = """
import gc, sys
from lightprobe.cli import main
command_function = main.command_function
def command(name, given):
    def told(): sys.exit(0 if gc.isenabled() and gc.get_freeze_count() > 10_000 else 1)
    assert not gc.isenabled()
    command_function(name, given)
    return told, ""
main.command_function = command
sys.argv = ["lightprobe", "predict"]
sys.exit(main.program() or 2)
"""
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


def test_written_cameras_can_be_read_back(trained):
    _, run = trained
    for photo in run.scene()["photos"]["train"].values():
        assert Camera.from_json(photo["camera"], source="x").width == SIZE

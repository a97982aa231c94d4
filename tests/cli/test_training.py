"""That a training's settings come from where the user expects them."""

import dataclasses
import json
import shlex

from lightprobe.cli import training
from lightprobe.cli.main import main
from lightprobe.core.config import distillation, reconstruction
from lightprobe.core.run import RunFolder
from lightprobe.models import LightAccuracy
from lightprobe.report.run_info import read_phases, training_commands
from tests.cli.commands import fails, succeed


def test_the_command_of_a_training_gives_its_settings_again(tmp_path, monkeypatch):
    run = RunFolder.create(tmp_path / "run")
    first = dataclasses.replace(
        reconstruction.standard(), shadows=False, sdf=reconstruction.SdfMode.MLP, coverage_weight=0.25
    )
    second = dataclasses.replace(
        distillation.standard(), pretrained=True, alpha_rule=distillation.AlphaRule.R2
    )
    run.record_config("decompose", {"seed": 5, **dataclasses.asdict(first)})
    run.record_config("distill", {"seed": 5, "hdri": None, **dataclasses.asdict(second)})
    given = []
    monkeypatch.setattr(training, "train_run", lambda *folders, **options: given.append(options) or run)
    (command,) = training_commands(read_phases(run), run.path)
    assert "--preset standard" in command
    assert main(shlex.split(command)[1:]) == 0
    assert given[0]["seed"] == 5
    assert (given[0]["decompose"], given[0]["distill"]) == (first, second)


def test_phase_two_asks_for_the_preset_of_phase_one(tmp_path, monkeypatch, capsys):
    run = RunFolder.create(tmp_path / "run")
    first = dataclasses.replace(reconstruction.paper(), pass1_iterations=7)
    run.record_config("decompose", {"seed": 0, **dataclasses.asdict(first)})
    given = []
    monkeypatch.setattr(training, "distill_run", lambda folder, **options: given.append(options) or run)
    assert fails(["distill", run.path], capsys, ["--preset paper"]) == 3
    assert given == []
    succeed("distill", run.path, "--preset", "paper")
    succeed("distill", run.path, "--preset", "quick")
    assert [options["distill"] for options in given] == [distillation.paper(), distillation.quick()]


def test_a_training_ends_with_what_to_expect_of_its_maps(tmp_path, monkeypatch, capsys):
    run, accuracy = (
        RunFolder.create(tmp_path / "run"),
        LightAccuracy("probe-net", 24, 0.5, (0.1, 0.2, 0.6), 0.8, 0.9),
    )
    accuracy.save(run.model_folder)
    run.record_config("decompose", {"seed": 0, **dataclasses.asdict(reconstruction.quick())})
    monkeypatch.setattr(training, "train_run", lambda *folders, **options: run)
    monkeypatch.setattr(training, "distill_run", lambda folder, **options: run)
    for command in (["train", run.path, "-o", run.path], ["distill", run.path]):
        succeed(*command)
        assert accuracy.sentence in capsys.readouterr().out
        succeed(*command, "--json")
        assert json.loads(capsys.readouterr().out)["light_accuracy"]["spheres"] == [0.1, 0.2, 0.6]

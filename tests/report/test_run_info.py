import dataclasses
from pathlib import Path

import pytest

from lightprobe.core.config import Preset, distillation, prediction, reconstruction
from lightprobe.core.run import RunFolder
from lightprobe.report.run_info import fitted_preset, read_phases, training_commands, training_facts

BUNDLED = Path("anywhere/lightprobe/assets/demo")


@pytest.fixture
def run(tmp_path):
    return RunFolder.create(tmp_path / "run")


def record(run: RunFolder, first, second=None, *, seeds=(0, 0), hdri=None) -> None:
    run.record_config("decompose", {"seed": seeds[0], **dataclasses.asdict(first)})
    if second is not None:
        run.record_config("distill", {"seed": seeds[1], "hdri": hdri, **dataclasses.asdict(second)})


def test_a_preset_is_recognised(run):
    record(run, reconstruction.standard(), distillation.standard(), seeds=(3, 3), hdri="/some/where")
    phases = read_phases(run)
    assert training_facts(phases) == {"preset": "standard", "seed": "3"}
    assert training_commands(phases, Path("x")) == [
        "lightprobe train SCENE -o RUN --preset standard --seed 3 --hdri HDRI"
    ]


def test_other_settings_are_told_by_their_steps_and_options(run):
    first = dataclasses.replace(reconstruction.quick(), pass1_iterations=12, shadows=False)
    record(run, first, dataclasses.replace(distillation.quick(), sphere_steps=0))
    phases = read_phases(run)
    assert training_facts(phases) == {
        "Phase I": "12 + 800 + 1500 steps",
        "Phase II": "2000 + 0 steps",
        "seed": "0",
    }
    assert training_commands(phases, BUNDLED) == [
        "lightprobe train SCENE -o RUN --preset quick --seed 0 --decompose.pass1-iterations 12 "
        "--decompose.no-shadows --distill.sphere-steps 0"
    ]


def test_the_demo_is_a_command_of_its_own_on_its_own_scene_only(run):
    record(run, reconstruction.demo(), distillation.demo())
    phases = read_phases(run)
    assert training_facts(phases) == {"preset": "demo", "seed": "0"}
    assert training_commands(phases, BUNDLED) == ["lightprobe demo -o RUN --seed 0"]
    (elsewhere,) = training_commands(phases, Path("photos/cup"))
    assert elsewhere.startswith(
        "lightprobe train SCENE -o RUN --preset quick --seed 0 --decompose.pass1-iterations 650"
    )


def test_phases_of_two_seeds_or_presets_are_two_commands(run):
    record(run, reconstruction.quick(), distillation.paper(), seeds=(0, 1))
    phases = read_phases(run)
    assert training_facts(phases) == {
        "Phase I": "preset quick",
        "Phase II": "preset paper",
        "seeds": "0 and 1",
    }
    assert training_commands(phases, Path("x")) == [
        "lightprobe fit SCENE -o RUN --preset quick --seed 0",
        "lightprobe distill RUN --preset paper --seed 1",
    ]


def test_one_phase_alone_is_fit(run):
    record(run, reconstruction.paper())
    assert training_commands(read_phases(run), Path("x")) == [
        "lightprobe fit SCENE -o RUN --preset paper --seed 0"
    ]


def test_how_the_run_predicts_belongs_to_its_preset(run):
    record(run, reconstruction.paper(), distillation.paper())
    run.record_config("predict", dataclasses.asdict(prediction.paper()))
    (command,) = training_commands(read_phases(run), Path("x"))
    assert command == "lightprobe train SCENE -o RUN --preset paper --seed 0"


def test_other_settings_of_predictions_are_options(run):
    record(run, reconstruction.paper(), distillation.paper())
    run.record_config("predict", dataclasses.asdict(prediction.quick()))
    assert training_facts(read_phases(run))["Phase I"] == "preset paper"
    (command,) = training_commands(read_phases(run), Path("x"))
    assert command.endswith(
        "--predict.light-resolution 32 --predict.max-pixels 65536 --predict.unseen-share 0.02"
    )
    assert "--predict.method None" in command


@pytest.mark.parametrize("change", [{}, {"gone": 1}, {"pass1_iterations": None}])
def test_settings_of_another_version_tell_nothing(run, change):
    settings = {"seed": 0, **dataclasses.asdict(reconstruction.quick())}
    del settings["shadows"]
    run.record_config(
        "decompose", {key: value for key, value in {**settings, **change}.items() if value is not None}
    )
    assert read_phases(run) == []
    assert training_facts([]) == {}
    assert training_commands([], BUNDLED) == []


def test_the_fitted_preset_is_told_while_the_second_phase_is_started_over(run, monkeypatch):
    record(run, reconstruction.standard(), distillation.standard())
    first, later = iter([run.sections()]), RunFolder.sections
    run.restart("distill", outputs=())  # by another process, after this one has looked once
    monkeypatch.setattr(RunFolder, "sections", lambda self: next(first, None) or later(self))
    assert fitted_preset(run) is Preset.STANDARD


def test_a_run_without_settings_tells_nothing(run):
    assert read_phases(run) == []

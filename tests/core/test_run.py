import subprocess
import sys

import pytest

from lightprobe.core.errors import ConfigError, InputError, ResourceError
from lightprobe.core.run import RunFolder

SCENE = {"root": "/photos", "photos": {"a": {"checksum": "12", "camera": {"fx": 100.0}}}}


def test_create_then_open(tmp_path):
    run = RunFolder.create(tmp_path / "deep" / "run")
    assert RunFolder.open(run.path).config_file.exists()
    assert RunFolder.create(run.path).path == run.path


def test_a_folder_with_other_things_is_not_taken_over(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(ConfigError, match="not empty"):
        RunFolder.create(tmp_path)
    with pytest.raises(ConfigError, match="is a file"):
        RunFolder.create(tmp_path / "thesis.tex")
    with pytest.raises(InputError, match="not a run folder"):
        RunFolder.open(tmp_path)


def test_the_same_scene_and_config_go_on(tmp_path):
    run = RunFolder.create(tmp_path)
    for _ in range(2):
        run.record_scene(SCENE)
        run.record_config("decompose", {"steps": 100, "sizes": (1, 2)})
        run.record_config("distill", {"steps": 5})
    assert run.config("decompose") == {"steps": 100, "sizes": [1, 2]}
    assert run.scene() == SCENE


def test_another_config_or_scene_is_refused_and_the_difference_named(tmp_path):
    run = RunFolder.create(tmp_path / "r")
    run.record_scene(SCENE)
    run.record_config("decompose", {"light": {"resolution": 16}, "steps": 100})
    with pytest.raises(ConfigError, match=r"decompose\.light\.resolution = 16, not 32.*--restart"):
        run.record_config("decompose", {"light": {"resolution": 32}, "steps": 100})
    with pytest.raises(ConfigError, match=r"scene\.photos\.a\.checksum = \"12\", not \"13\".*have changed"):
        run.record_scene({**SCENE, "photos": {"a": {**SCENE["photos"]["a"], "checksum": "13"}}})
    assert run.scene() == SCENE


@pytest.mark.parametrize("given", [{"seed": 1, "new": 0.5}, {}])
def test_settings_of_another_version_are_told_from_other_options(tmp_path, given):
    run = RunFolder.create(tmp_path / "run")
    run.record_config("decompose", {"seed": 0})
    with pytest.raises(ConfigError, match="another version of lightprobe") as refused:
        run.record_config("decompose", given)
    assert "same options" not in str(refused.value)


def test_a_phase_that_never_ran_has_no_config(tmp_path):
    with pytest.raises(InputError, match="'distill'"):
        RunFolder.create(tmp_path).config("distill")


def test_restart_forgets_one_phase(tmp_path):
    run = RunFolder.create(tmp_path)
    for phase in ("decompose", "distill"):
        run.record_config(phase, {"steps": 1})
        run.append_metrics(phase, 1, {"loss": 0.5})
    run.model_folder.mkdir()
    run.restart("distill", outputs=(run.model_folder, run.metrics_file))
    run.record_config("distill", {"steps": 2})
    assert run.config("decompose") == {"steps": 1}
    assert not run.model_folder.exists()
    assert run.metrics_log.read_text().count("\n") == 1


def test_rewound_metrics_equal_those_of_an_uninterrupted_run(tmp_path):
    straight, resumed = RunFolder.create(tmp_path / "straight"), RunFolder.create(tmp_path / "resumed")
    for step in range(0, 60, 10):
        straight.append_metrics("decompose", step, {"loss": 1 / (1 + step)})
    for step in range(0, 50, 10):
        resumed.append_metrics("decompose", step, {"loss": 1 / (1 + step)})
    with open(resumed.metrics_log, "a") as file:
        file.write('{"phase": "decompose", "st')  # killed while writing
    resumed.rewind_metrics("decompose", 20)
    for step in range(30, 60, 10):
        resumed.append_metrics("decompose", step, {"loss": 1 / (1 + step)})
    assert resumed.metrics_log.read_bytes() == straight.metrics_log.read_bytes()


def test_a_line_that_is_to_stand_once_is_not_written_again(tmp_path):
    run = RunFolder.create(tmp_path)
    for value in (0.5, 0.5, 0.25):
        run.append_metrics("decompose", 10, {"held_out": value}, once=True)
    assert run.metrics_log.read_text().count("\n") == 2


def test_rewinding_a_later_phase_keeps_the_earlier_one(tmp_path):
    run = RunFolder.create(tmp_path)
    for phase in ("decompose", "distill"):
        for step in (10, 20):
            run.append_metrics(phase, step, {})
    run.rewind_metrics("distill", 10)
    assert run.metrics_log.read_text().count("\n") == 3
    run.rewind_metrics("decompose", 10)
    assert run.metrics_log.read_text().count("\n") == 1


def test_writing_clears_leftovers_of_a_killed_writer(tmp_path):
    run = RunFolder.create(tmp_path)
    (tmp_path / "checkpoints" / ".partial-abc").mkdir(parents=True)
    (tmp_path / "checkpoints" / ".partial-abc" / "tensors.safetensors").write_text("half")
    (tmp_path / ".partial-x.exr").write_text("half")
    with run.writing():
        assert not list(tmp_path.rglob(".partial-*"))


@pytest.mark.slow
def test_only_one_process_writes(tmp_path):
    run = RunFolder.create(tmp_path)
    code = (
        "import sys\nfrom lightprobe.core.run import RunFolder\n"
        f"with RunFolder({str(tmp_path)!r}).writing():\n    print('held', flush=True)\n    sys.stdin.read()"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert other.stdout.readline() == "held\n"
    with pytest.raises(ResourceError, match="another lightprobe process"), run.writing():
        pass
    other.kill()
    other.wait()
    with run.writing():
        pass


def test_paths_are_those_of_the_documented_layout(tmp_path):
    run = RunFolder(tmp_path)
    assert run.environment_file("a") == tmp_path / "env/a.exr"
    assert run.prediction_file("a", ".exr") == tmp_path / "predictions/a.exr"
    assert run.prediction_file("a", ".png", "solve") == tmp_path / "predictions/solve/a.png"
    assert run.asset_file == tmp_path / "mesh/asset.safetensors"
    assert run.model_checkpoints.folder == tmp_path / "model/checkpoints"


def test_another_writer_of_a_new_run_is_told_so(tmp_path, monkeypatch):
    """Both found no config.json; the second came while the first, stalled, held the run."""
    stalled = RunFolder(tmp_path)
    with stalled.writing(), pytest.raises(ResourceError, match="another lightprobe process"):
        RunFolder.create(tmp_path)
    assert RunFolder.create(tmp_path).sections() == {}


def test_a_stalled_creation_takes_nothing_back(tmp_path, monkeypatch):
    """Between the look for config.json and its writing another process made the run and recorded its
    settings.
    """
    original, stalled = RunFolder.writing, []

    def stall(self):
        if not stalled:
            stalled.append(True)
            RunFolder.create(tmp_path).record_config("decompose", {"steps": 7})
        return original(self)

    monkeypatch.setattr(RunFolder, "writing", stall)
    assert RunFolder.create(tmp_path).config("decompose") == {"steps": 7}


def test_damaged_records_are_named_with_the_remedy(tmp_path):
    run = RunFolder.create(tmp_path)
    for content in ("[]", "", '{"root": 3}', '{"root": "a\\u0000b"}'):
        run.scene_file.write_text(content)
        with pytest.raises(InputError, match=r"scene\.json .*--restart"):
            run.scene()
    for content in ("[]", "", '{"distill": []}'):
        run.config_file.write_text(content)
        with pytest.raises(InputError, match=r"config\.json .*--restart"):
            run.config("distill")


@pytest.mark.parametrize(
    "line", ["[]", "1", '{"phase": "distill"}', "{" * 9999, '{"phase": "distill", "step": "x"}']
)
def test_a_damaged_line_of_metrics_ends_what_is_kept(tmp_path, line):
    run = RunFolder.create(tmp_path)
    run.append_metrics("decompose", 10, {})
    kept = run.metrics_log.read_bytes()
    run.metrics_log.write_bytes(kept + line.encode() + b"\n" + kept)
    run.rewind_metrics("distill", 10)
    assert run.metrics_log.read_bytes() == kept

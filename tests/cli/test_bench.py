"""The bookkeeping of a benchmark; the commands it runs have tests of their own."""

import json
from pathlib import Path

import pytest

from lightprobe.cli import bench, main
from lightprobe.cli.bench import LOSSES, find_scene, share_phase_one, training_costs
from lightprobe.core.config import Preset
from lightprobe.core.config_distill import DistillConfig
from lightprobe.core.run import RunFolder


@pytest.fixture
def calls(monkeypatch):
    """Commands given to the program, which writes the files that the true ones would."""
    given = []

    def fake(arguments):
        given.append(arguments)
        words = list(arguments)
        if words[0] == "train":
            run = RunFolder.create(Path(words[words.index("-o") + 1]))
            run.record_config("decompose", {"seed": 0})
            for path in (run.asset_file, run.scene_file, run.model_folder / "config.json"):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("{}")
            run.log("decompose finished in 10:30")
        if words[0] == "eval":
            run = RunFolder(Path(words[1]))
            run = run.oracle if "--oracle-asset" in words else run
            run.path.mkdir(exist_ok=True)
            scores = {"psnr": 20.0 + len(given)}
            value = {"methods": {"probe-mlp": scores}, "mean": scores, "default_method": "probe-mlp", "photos": {}}
            run.metrics_file.write_text(json.dumps(value))
        return 0

    monkeypatch.setattr(main, "main", fake)
    return given


def ask(tmp_path, *, seeds: int, scenes=("chair", "cup", "gone")) -> None:
    bench.bench(
        scenes=scenes, data=tmp_path / "data", output=tmp_path / "out", seeds=seeds, results=tmp_path / "R.md",
        preset=Preset.QUICK,
    )  # fmt: skip


@pytest.fixture
def data(tmp_path):
    for place in ("chair", "real/cup"):
        (tmp_path / "data" / place).mkdir(parents=True)
    return tmp_path / "data"


def test_scenes_are_found_at_most_one_folder_down(data):
    assert find_scene(data, "chair") == data / "chair"
    assert find_scene(data, "cup") == data / "real" / "cup"
    assert find_scene(data, "gone") is None


def test_every_piece_is_made_once_and_the_missing_scene_is_named(data, tmp_path, calls, capsys):
    ask(tmp_path, seeds=2)
    assert [words[0] for words in calls] == ["train", "eval"] * 2 + ["distill", "eval"] * len(LOSSES) * 2
    assert "SKIPPED gone" in capsys.readouterr().out
    page = (tmp_path / "R.md").read_text()
    assert "gone, for which there are no numbers" in page
    assert page.count("alpha² = r²") >= 1
    assert "| 630 |" in page  # seconds of Phase I, from the log
    calls.clear()
    ask(tmp_path, seeds=2)
    assert calls == []
    (tmp_path / "out" / "pieces" / "cup.eval.json").unlink()
    ask(tmp_path, seeds=2)
    assert [words[:2] for words in calls] == [["eval", str(tmp_path / "out" / "runs" / "cup")]]


def test_a_failed_piece_does_not_stop_the_others(data, tmp_path, calls, monkeypatch):
    good = main.main
    monkeypatch.setattr(main, "main", lambda words: 2 if words[0] == "eval" and "cup" in words[1] else good(words))
    with pytest.raises(Exception, match=r"cup\.eval"):
        ask(tmp_path, seeds=0, scenes=("cup", "chair"))
    assert (tmp_path / "out" / "pieces" / "chair.eval.json").is_file()


def test_an_interruption_ends_the_benchmark(data, tmp_path, monkeypatch):
    monkeypatch.setattr(main, "main", lambda words: 130)
    with pytest.raises(KeyboardInterrupt):
        ask(tmp_path, seeds=0)


def test_no_scene_at_all_is_an_error(data, tmp_path):
    with pytest.raises(Exception, match="None of gone"):
        ask(tmp_path, seeds=0, scenes=("gone",))


def test_variants_share_phase_one_and_nothing_else(data, tmp_path, calls):
    ask(tmp_path, seeds=0, scenes=("chair",))
    source, run = RunFolder(tmp_path / "out" / "runs" / "chair"), RunFolder(tmp_path / "variant")
    share_phase_one(source, run)
    assert run.config("decompose") == {"seed": 0}
    assert run.asset_file.is_file()
    assert not run.model_folder.exists()


def test_times_of_interrupted_phases_are_not_reported(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    assert training_costs(run) == {}
    for line in ("decompose starts", "decompose goes on from step 3", "decompose finished in 1:05"):
        run.log(line)
    run.log("distill finished in 0:42, 1.25 GiB at most")
    assert training_costs(run) == {"distill": 42, "memory": 1.25}


def test_options_of_the_losses_exist():
    for options in LOSSES.values():
        for option in options:
            if option.startswith("--"):
                name = option.removeprefix("--distill.").removeprefix("no-").replace("-", "_")
                assert name in DistillConfig.__dataclass_fields__

"""The bookkeeping of a benchmark; the commands it runs have tests of their own."""

import json
from pathlib import Path

import pytest

from lightprobe.cli import bench, main
from lightprobe.cli.bench import LOSSES, find_scene, learned_methods, share_phase_one, training_costs, without_places
from lightprobe.core.config import Preset
from lightprobe.core.config_distill import DistillConfig
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.run import RunFolder


@pytest.fixture
def true_objects():
    """Names of the scenes that bring their object."""
    return set()


@pytest.fixture
def calls(monkeypatch, true_objects):
    """Commands given to the program, which writes the files that the true ones would."""
    given = []

    def fake(arguments):
        given.append(arguments)
        words = list(arguments)
        if words[0] == "distill":
            assert RunFolder(Path(words[1])).asset_file.is_file()
        if words[0] == "train":
            run = RunFolder.create(Path(words[words.index("-o") + 1]))
            run.record_config("decompose", {"seed": 0})
            for path in (run.asset_file, run.scene_file, run.model_folder / "config.json"):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("{}")
            run.log("decompose finished in 10:30")
        if words[0] == "eval":
            run = RunFolder(Path(words[1]))
            run.oracle.path.mkdir(exist_ok=True)
            if run.path.name in true_objects:
                run.oracle.asset_file.parent.mkdir(exist_ok=True)
                run.oracle.asset_file.write_text("{}")
            run = run.oracle if "--oracle-asset" in words else run
            scores = {"psnr": 20.0 + len(given)}
            methods = dict.fromkeys(("constant", "probe-mlp", "probe-net", "solve"), scores)
            value = {"methods": methods, "mean": scores, "default_method": "probe-net", "photos": {}}
            run.metrics_file.write_text(json.dumps(value))
        return 0

    monkeypatch.setattr(main, "main", fake)
    return given


def ask(tmp_path, *, seeds: int, scenes=("chair", "cup", "gone"), hdri=None, preset=Preset.QUICK) -> None:
    bench.bench(
        scenes=scenes, data=tmp_path / "data", output=tmp_path / "out", seeds=seeds, results=tmp_path / "R.md",
        preset=preset, hdri=hdri,
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


def test_a_shared_phase_one_follows_a_scene_that_has_moved(data, tmp_path, calls):
    ask(tmp_path, seeds=0, scenes=("chair",))
    source, run = RunFolder(tmp_path / "out" / "runs" / "chair"), RunFolder(tmp_path / "variant")
    source.scene_file.write_text(json.dumps({"root": "/old/chair", "photos": {"a": 1}}))
    share_phase_one(source, run)
    run.record_scene({"root": "/new/chair", "photos": {"a": 1}})  # what --scene comes to
    assert (source.scene()["root"], run.scene()["root"]) == ("/old/chair", "/new/chair")


@pytest.fixture
def hdris(tmp_path):
    folder = tmp_path / "hdris"
    folder.mkdir()
    (folder / "sky.exr").write_bytes(b"")
    return folder


def test_hdri_lessons_are_a_second_phase_two_after_all_usual_ones(data, tmp_path, calls, hdris, true_objects):
    true_objects.add("chair")
    ask(tmp_path, seeds=0, hdri=hdris)
    usual, second = calls[:5], calls[5:]
    assert [words[0] for words in usual] == ["train", "eval", "eval", "train", "eval"]
    assert not any("--hdri" in words for words in usual)
    assert [words[0] for words in second] == ["distill", "eval", "eval", "distill", "eval"]
    assert all(Path(words[1]) == tmp_path / "out" / "hdri" / name for words, name in zip(
        second, ["chair"] * 3 + ["cup"] * 2, strict=True
    ))  # fmt: skip
    assert second[0][second[0].index("--hdri") + 1] == str(hdris)
    assert all(words[words.index("--scene") + 1].startswith(str(data)) for words in second)
    methods = second[1].index("--methods") + 1
    assert second[1][methods:] == ["probe-net", "probe-mlp"]  # the default first, none that is without a model
    assert second[2] == [*second[1], "--oracle-asset"]
    pieces = {file.name for file in (tmp_path / "out" / "pieces").iterdir()}
    assert {"chair.hdri.eval.json", "chair.hdri.oracle.json", "cup.hdri.eval.json"} < pieces
    page = (tmp_path / "R.md").read_text()
    assert "| chair, HDRI lessons | probe-net |" in page
    assert "gone with HDRI lessons, for which there are no numbers" in page
    assert "630 |" in page.split("## Seconds")[1]  # of the usual training
    calls.clear()
    ask(tmp_path, seeds=0, hdri=hdris)
    assert calls == []


def test_failed_hdri_lessons_stop_nothing_and_go_on_next_time(data, tmp_path, calls, monkeypatch, hdris):
    good = main.main
    with monkeypatch.context() as patch:
        patch.setattr(main, "main", lambda words: 2 if words[0] == "distill" and "cup" in words[1] else good(words))
        with pytest.raises(Exception, match=r"failed.*: cup\.hdri training\.$"):
            ask(tmp_path, seeds=0, scenes=("cup", "chair"), hdri=hdris)
    assert (tmp_path / "out" / "pieces" / "chair.hdri.eval.json").is_file()
    calls.clear()
    ask(tmp_path, seeds=0, scenes=("cup", "chair"), hdri=hdris)
    assert [words[0] for words in calls] == ["distill", "eval"]


def test_hdris_that_cannot_serve_are_refused_before_any_training(data, tmp_path, calls, hdris):
    with pytest.raises(InputError, match="no \\.exr or \\.hdr"):
        ask(tmp_path, seeds=0, hdri=data)
    with pytest.raises(ConfigError, match="--preset paper"):
        ask(tmp_path, seeds=0, hdri=hdris, preset=Preset.PAPER)
    assert calls == []


def test_no_folder_of_the_machine_is_on_the_page_or_in_the_pieces(data, tmp_path, calls, hdris):
    ask(tmp_path, seeds=1, hdri=hdris)
    old = tmp_path / "out" / "pieces" / "cup.eval.json"
    stored = json.loads(old.read_text())
    assert stored["command"].startswith("lightprobe eval RUNS/cup --scene DATA/real/cup --slow")
    old.write_text(json.dumps({**stored, "command": f"lightprobe eval /else/where/cup --scene {data}/real/cup"}))
    ask(tmp_path, seeds=1, hdri=hdris)
    page = (tmp_path / "R.md").read_text()
    assert "lightprobe eval cup --scene DATA/real/cup " in page
    assert "lightprobe eval FOLDER/hdri/chair --scene DATA/chair --slow-photos 2 --methods probe-net probe-mlp" in page
    pieces = [file.read_text() for file in (tmp_path / "out" / "pieces").iterdir() if file != old]
    assert not any(str(tmp_path) in text for text in (page, *pieces))


def test_places_are_named_by_whole_folders_the_innermost_first():
    places = {"DATA": Path("/my data"), "RUNS": Path("out/runs"), "FOLDER": Path("out")}
    assert without_places("eval out/runs/a --scene /my data/a", places) == "eval RUNS/a --scene DATA/a"
    assert without_places("eval out/hdri/a --scene layout/a", places) == "eval FOLDER/hdri/a --scene layout/a"


def test_methods_that_depend_on_phase_two():
    methods = dict.fromkeys(("optimize", "solve", "probe-mlp+solve", "constant", "probe-net+optimize"))
    assert learned_methods({"default_method": "probe-net+optimize", "methods": methods}) == [
        "probe-net+optimize", "probe-mlp+solve",
    ]  # fmt: skip


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

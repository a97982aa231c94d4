"""The bookkeeping of a benchmark; the commands it runs have tests of their own."""

import json
from pathlib import Path

import pytest

from lightprobe.cli import bench, main
from lightprobe.cli.bench import LESSONS, LOSSES, find_scene, share_phase_one, training_costs, without_places
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
    variants = len(LESSONS) * 2 + len(LOSSES) * 2
    assert [words[0] for words in calls] == ["train", "eval"] * 2 + ["distill", "eval"] * variants
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


def test_every_kind_of_lessons_is_another_phase_two_after_all_usual_ones(data, tmp_path, calls, hdris, true_objects):
    true_objects.add("chair")
    ask(tmp_path, seeds=0, hdri=hdris)
    usual, second = calls[:5], calls[5:]
    assert [words[0] for words in usual] == ["train", "eval", "eval", "train", "eval"]
    assert [words[0] for words in second] == ["distill", "eval"] * 3 * 2
    places = ["photos-alone", "re-rendered-alone", "with-HDRIs"]
    runs = [tmp_path / "out" / "variants" / f"{name}.lessons.{kind}" for name in ("chair", "cup") for kind in places]
    assert [Path(words[1]) for words in second[::2]] == [Path(words[1]) for words in second[1::2]] == runs
    assert [words[words.index("--distill.lessons") + 1] for words in second[0:4:2]] == ["teacher", "synthetic"]
    assert second[4][second[4].index("--hdri") + 1] == str(hdris)
    assert all(words[words.index("--scene") + 1].startswith(str(data)) for words in second)
    assert second[1][second[1].index("--methods") + 1 :] == ["probe-net+optimize", "probe-net", "probe-mlp"]
    page = (tmp_path / "R.md").read_text()
    assert "| chair | probe-net | with HDRIs |" in page
    assert "lightprobe distill RUN --restart --preset quick --seed 0 --hdri HDRI   # with HDRIs" in page
    assert "630 |" in page.split("## Seconds")[1]  # of the usual training
    calls.clear()
    ask(tmp_path, seeds=0, hdri=hdris)
    assert calls == []
    ask(tmp_path, seeds=0)
    assert "| chair | probe-net | with HDRIs |" in (tmp_path / "R.md").read_text()  # what is known stays


def test_the_papers_preset_has_no_other_lessons(data, tmp_path, calls):
    ask(tmp_path, seeds=0, preset=Preset.PAPER)
    assert [words[0] for words in calls] == ["train", "eval"] * 2


def test_failed_lessons_stop_nothing_and_go_on_next_time(data, tmp_path, calls, monkeypatch, hdris):
    good = main.main
    with monkeypatch.context() as patch:
        patch.setattr(main, "main", lambda words: 2 if words[0] == "distill" and "--hdri" in words else good(words))
        with pytest.raises(Exception, match=r"failed.*: cup\.lessons\.with-HDRIs training, chair\.lessons"):
            ask(tmp_path, seeds=0, scenes=("cup", "chair"), hdri=hdris)
    assert (tmp_path / "out" / "pieces" / "chair.lessons.photos-alone.json").is_file()
    assert "cup with lessons 'with HDRIs', for which there are no numbers" in (tmp_path / "R.md").read_text()
    calls.clear()
    ask(tmp_path, seeds=0, scenes=("cup", "chair"), hdri=hdris)
    assert [words[0] for words in calls] == ["distill", "eval"] * 2


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
    assert "lightprobe eval FOLDER/variants/chair.lessons.with-HDRIs --scene DATA/chair --methods probe-net" in page
    pieces = [file.read_text() for file in (tmp_path / "out" / "pieces").iterdir() if file != old]
    assert not any(str(tmp_path) in text for text in (page, *pieces))


def test_places_are_named_by_whole_folders_the_innermost_first():
    places = {"DATA": Path("/my data"), "RUNS": Path("out/runs"), "FOLDER": Path("out")}
    assert without_places("eval out/runs/a --scene /my data/a", places) == "eval RUNS/a --scene DATA/a"
    assert without_places("eval out/hdri/a --scene layout/a", places) == "eval FOLDER/hdri/a --scene layout/a"


def test_times_of_interrupted_phases_are_not_reported(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    assert training_costs(run) == {}
    for line in ("decompose starts", "decompose goes on from step 3", "decompose finished in 1:05"):
        run.log(line)
    run.log("distill finished in 0:42, 1.25 GiB at most")
    assert training_costs(run) == {"distill": 42, "memory": 1.25}


def test_options_of_the_variants_exist():
    for options in (*LOSSES.values(), *LESSONS.values()):
        for option in options:
            if option.startswith("--"):
                name = option.removeprefix("--distill.").removeprefix("no-").replace("-", "_")
                assert name in DistillConfig.__dataclass_fields__

"""The bookkeeping of a benchmark; the commands it runs have tests of their own."""

import json
from pathlib import Path

import pytest

from lightprobe.cli import bench, main
from lightprobe.cli.bench import Step, find_scene
from lightprobe.cli.benchmark import LESSONS, LOSSES, paper_options, share_phase_one
from lightprobe.core.config import DecomposeConfig, Preset, distill_preset
from lightprobe.core.config_distill import DistillConfig
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.run import RunFolder
from lightprobe.report.records import Record


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
            scores = {"psnr": 20.0 + len(given), "ssim": 0.5}
            names = (
                words[words.index("--methods") + 1 :] if "--methods" in words else ("probe-net", "probe-mlp", "solve")
            )
            methods = {name: scores for name in names if not name.startswith("--")}
            value = {
                "methods": methods, "mean": scores, "default_method": next(iter(methods)),
                "photos": {"a": {"methods": methods}},
            }  # fmt: skip
            run.metrics_file.write_text(json.dumps(value))
        return 0

    monkeypatch.setattr(main, "main", fake)
    return given


def ask(
    tmp_path, *, seeds=(0,), scenes=("chair", "cup", "gone"), hdri=None, preset=Preset.QUICK,
    steps=(Step.RUN, Step.LESSONS), paper_iterations=(),
) -> None:  # fmt: skip
    bench.bench(
        scenes=scenes, data=tmp_path / "data", output=tmp_path / "out", seeds=seeds, results=tmp_path / "R.md",
        records=tmp_path / "records", preset=preset, hdri=hdri, steps=steps, paper_iterations=paper_iterations,
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
    everything = tuple(Step)
    ask(tmp_path, seeds=(0, 1), steps=everything)
    variants = len(LESSONS) * 2 + len(LOSSES) * 2
    assert [words[0] for words in calls] == ["train", "eval"] * 4 + ["distill", "eval"] * variants
    assert "SKIPPED gone" in capsys.readouterr().out
    page = (tmp_path / "R.md").read_text()
    assert "gone, for which there are no numbers" in page
    assert page.count("alpha² = r²") >= 1
    assert "| 630 |" in page  # seconds of Phase I, from the log
    calls.clear()
    capsys.readouterr()
    ask(tmp_path, seeds=(0, 1), steps=everything)
    assert calls == []
    assert (
        f"KEPT cup.seed1: scored at {Record.read(tmp_path / 'records' / 'cup.json').commit}" in capsys.readouterr().out
    )
    (tmp_path / "records" / "cup.json").unlink()
    ask(tmp_path, seeds=(0, 1), steps=everything)
    assert [words[:2] for words in calls] == [["eval", str(tmp_path / "out" / "runs" / "cup")]]


def test_a_failed_piece_does_not_stop_the_others(data, tmp_path, calls, monkeypatch):
    good = main.main
    monkeypatch.setattr(main, "main", lambda words: 2 if words[0] == "eval" and "cup" in words[1] else good(words))
    with pytest.raises(Exception, match=r"failed.*: cup\."):
        ask(tmp_path, scenes=("cup", "chair"))
    assert (tmp_path / "records" / "chair.json").is_file()


def test_an_interruption_ends_the_benchmark(data, tmp_path, monkeypatch):
    monkeypatch.setattr(main, "main", lambda words: 130)
    with pytest.raises(KeyboardInterrupt):
        ask(tmp_path)


def test_no_scene_at_all_is_an_error(data, tmp_path):
    with pytest.raises(Exception, match="None of gone"):
        ask(tmp_path, scenes=("gone",))


def test_variants_share_phase_one_and_nothing_else(data, tmp_path, calls):
    ask(tmp_path, scenes=("chair",))
    source, run = RunFolder(tmp_path / "out" / "runs" / "chair"), RunFolder(tmp_path / "variant")
    share_phase_one(source, run)
    assert run.config("decompose") == {"seed": 0}
    assert run.asset_file.is_file()
    assert not run.model_folder.exists()


def test_a_shared_phase_one_follows_a_scene_that_has_moved(data, tmp_path, calls):
    ask(tmp_path, scenes=("chair",))
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
    ask(tmp_path, hdri=hdris)
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
    assert "630 |" in page.split("## Seconds")[1]  # of the usual training
    calls.clear()
    ask(tmp_path, hdri=hdris)
    assert calls == []
    ask(tmp_path)
    assert "| chair | probe-net | with HDRIs |" in (tmp_path / "R.md").read_text()  # what is known stays


def test_the_papers_preset_has_no_other_lessons(data, tmp_path, calls):
    ask(tmp_path, preset=Preset.PAPER)
    assert [words[0] for words in calls] == ["train", "eval"] * 2


def test_failed_lessons_stop_nothing_and_go_on_next_time(data, tmp_path, calls, monkeypatch, hdris):
    good = main.main
    with monkeypatch.context() as patch:
        patch.setattr(main, "main", lambda words: 2 if words[0] == "distill" and "--hdri" in words else good(words))
        with pytest.raises(Exception, match=r"failed.*: cup\.lessons\.with-HDRIs training, chair\.lessons"):
            ask(tmp_path, scenes=("cup", "chair"), hdri=hdris)
    assert (tmp_path / "records" / "chair.lessons.photos-alone.json").is_file()
    calls.clear()
    ask(tmp_path, scenes=("cup", "chair"), hdri=hdris)
    assert [words[0] for words in calls] == ["distill", "eval"] * 2


def test_hdris_that_cannot_serve_are_refused_before_any_training(data, tmp_path, calls, hdris):
    with pytest.raises(InputError, match="no \\.exr or \\.hdr"):
        ask(tmp_path, hdri=data)
    with pytest.raises(ConfigError, match="--preset paper"):
        ask(tmp_path, hdri=hdris, preset=Preset.PAPER)
    assert calls == []


def test_no_folder_of_the_machine_is_on_the_pages_or_in_the_records(data, tmp_path, calls, hdris):
    ask(tmp_path, hdri=hdris, steps=(*Step,))
    cup = Record.read(tmp_path / "records" / "cup.json")
    assert cup.command.startswith("lightprobe eval RUNS/cup --scene DATA/real/cup --slow")
    page = (tmp_path / "R.md").read_text()
    assert "lightprobe eval FOLDER/variants/chair.lessons.with-HDRIs --scene DATA/chair --methods probe-net" in page
    files = [*(tmp_path / "records").iterdir(), tmp_path / "R.md", tmp_path / "paper-tables.md"]
    assert not any(str(tmp_path) in file.read_text() for file in files)


def test_a_record_tells_how_it_was_made(data, tmp_path, calls):
    ask(tmp_path, seeds=(4,), scenes=("chair",), steps=(Step.RUN,))
    record = Record.read(tmp_path / "records" / "chair.json")
    assert (record.seed, record.preset, record.training) == (4, "quick", {"decompose": 630})
    assert record.commit == record.trained
    assert all((record.commit, record.machine, record.threads))
    (tmp_path / "records" / "chair.json").unlink()
    (tmp_path / "out" / "runs" / "chair" / "bench.json").unlink()  # trained by somebody else
    ask(tmp_path, seeds=(4,), scenes=("chair",), steps=(Step.RUN,))
    assert Record.read(tmp_path / "records" / "chair.json").trained == ""


def test_other_seeds_train_the_default_alone_in_runs_of_their_own(data, tmp_path, calls):
    ask(tmp_path, seeds=(0, 1, 2), scenes=("chair",), steps=(Step.RUN, Step.SEEDS))
    runs = tmp_path / "out" / "runs"
    assert [words[0] for words in calls] == ["train", "eval"] * 3
    for place, seed in ((2, 1), (4, 2)):
        train, score = calls[place], calls[place + 1]
        assert train[train.index("-o") + 1] == score[1] == str(runs / f"chair.seed{seed}")
        assert train[train.index("--seed") + 1] == str(seed)
        assert score[score.index("--methods") + 1 :] == ["probe-net"]
    assert "| chair | 0, 1, 2 | 24." in (tmp_path / "R.md").read_text()  # 22, 24 and 26


def test_seeds_wait_for_the_run_that_names_the_default(data, tmp_path, calls):
    ask(tmp_path, seeds=(0, 1), scenes=("chair",), steps=(Step.SEEDS,))
    assert calls == []


def test_the_paper_s_settings_get_a_run_of_their_own_that_says_how_long_it_was(data, tmp_path, calls):
    ask(tmp_path, scenes=("chair",), steps=(Step.RUN, Step.PAPER), paper_iterations=(1500, 20))
    train, score = calls[2:]
    assert train[train.index("-o") + 1] == str(tmp_path / "out" / "runs" / "chair.paper")
    assert train[train.index("--preset") + 1] == "paper"
    assert [train[train.index(f"--decompose.pass{i}-iterations") + 1] for i in (1, 2)] == ["1500", "1500"]
    assert train[train.index("--distill.steps") + 1] == "20"
    assert score[score.index("--methods") + 1 :] == ["probe-mlp"]
    record = Record.read(tmp_path / "records" / "chair.paper.json")
    assert (record.iterations, record.preset) == ("1500 of 40 000 + 20 of 30 000", "paper")
    named = "probe-mlp, paper's settings, 1500 of 40 000 + 20 of 30 000 iterations"
    assert named in (tmp_path / "R.md").read_text()
    with pytest.raises(ConfigError, match="1500 of 40 000"):  # never two lengths under one name
        ask(tmp_path, scenes=("chair",), steps=(Step.PAPER,), paper_iterations=(9, 9))


def test_the_paper_s_options_are_its_own_where_nothing_is_cut():
    options, iterations = paper_options(10**6, 10**6)
    settings = DecomposeConfig.preset(Preset.PAPER)
    assert options[:2] == ("--preset", "paper")
    given = dict(zip(options[2::2], options[3::2], strict=True))
    for option, value in given.items():
        section, _, name = option.removeprefix("--").partition(".")
        owner = settings if section == "decompose" else distill_preset(Preset.PAPER)
        assert getattr(owner, name.replace("-", "_")) == int(value)
    assert iterations == "40 000 + 30 000"


def test_records_of_other_settings_are_not_taken_for_these(data, tmp_path, calls):
    ask(tmp_path, scenes=("chair",), steps=(Step.RUN,))
    with pytest.raises(ConfigError, match=r"chair\.json was made with seed 0, not 5"):
        ask(tmp_path, seeds=(5,), scenes=("chair",), steps=(Step.RUN,))


def test_the_pages_are_written_from_records_alone(data, tmp_path, calls):
    ask(tmp_path, scenes=("chair",), steps=(Step.RUN,))
    before = (tmp_path / "R.md").read_text()
    calls.clear()
    pages = {"results": tmp_path / "again" / "R.md", "tables_only": True}
    bench.bench(records=tmp_path / "records", data=tmp_path / "gone", **pages)
    assert calls == []
    assert pages["results"].read_text() == before
    assert (tmp_path / "again" / "paper-tables.md").is_file()
    with pytest.raises(ConfigError, match="--records"):
        bench.bench(records=tmp_path / "no", **pages)


@pytest.mark.parametrize(
    "wrong",
    [
        {"seeds": ()}, {"seeds": (1, 1)}, {"seeds": (-1,)}, {"paper_iterations": (5,)}, {"paper_iterations": (0, 5)},
        {"steps": (Step.PAPER,)}, {"preset": Preset.PAPER, "paper_iterations": (5, 5)},
    ],
)  # fmt: skip
def test_options_that_make_no_sense_are_refused_before_any_training(data, tmp_path, calls, wrong):
    with pytest.raises(ConfigError):
        ask(tmp_path, **wrong)
    assert calls == []


def test_options_of_the_variants_exist():
    for options in (*LOSSES.values(), *LESSONS.values()):
        for option in options:
            if option.startswith("--"):
                name = option.removeprefix("--distill.").removeprefix("no-").replace("-", "_")
                assert name in DistillConfig.__dataclass_fields__

"""The bookkeeping of a benchmark, whose commands a program of the test's own takes."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from benchmarks.record import Record
from benchmarks.run import (
    LESSONS,
    LOSSES,
    BenchOptions,
    Step,
    find_scene,
    paper_options,
    run_bench,
    share_phase_one,
)
from benchmarks.tables import Tables, write_pages
from lightprobe.core.config import Preset, settings
from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.run import RunFolder
from tests.benchmarks.program import Program


@pytest.fixture
def program():
    return Program()


@pytest.fixture
def calls(program):
    """Commands given to the program."""
    return program.calls


@pytest.fixture
def ask(tmp_path, program):
    def make(
        *,
        seeds=(0,),
        scenes=("chair", "cup", "gone"),
        hdri=None,
        preset=Preset.QUICK,
        steps=(Step.RUN, Step.LESSONS),
        paper_iterations=(),
        slow_photos=2,
    ) -> None:
        options = BenchOptions(
            scenes=scenes,
            data=tmp_path / "data",
            output=tmp_path / "out",
            seeds=seeds,
            results=tmp_path / "R.md",
            records=tmp_path / "records",
            preset=preset,
            hdri=hdri,
            steps=steps,
            paper_iterations=paper_iterations,
            slow_photos=slow_photos,
        )
        run_bench(options, program)

    return make


@pytest.fixture
def data(tmp_path):
    for place in ("chair", "real/cup"):
        (tmp_path / "data" / place).mkdir(parents=True)
    return tmp_path / "data"


def test_scenes_are_found_at_most_one_folder_down(data):
    assert find_scene(data, "chair") == data / "chair"
    assert find_scene(data, "cup") == data / "real" / "cup"
    assert find_scene(data, "gone") is None


@pytest.mark.slow
def test_every_piece_is_made_once_and_the_missing_scene_is_named(data, tmp_path, calls, capsys, ask):
    everything = tuple(Step)
    ask(seeds=(0, 1), steps=everything)
    variants = len(LESSONS) * 2 + len(LOSSES) * 2
    assert [words[0] for words in calls] == ["train", "eval"] * 4 + ["distill", "eval"] * variants
    assert "SKIPPED gone" in capsys.readouterr().out
    page = (tmp_path / "R.md").read_text()
    assert "gone, for which there are no numbers" in page
    assert page.count("alpha² = r²") >= 1
    assert "| 630 |" in page  # seconds of Phase I, from timings.json
    calls.clear()
    capsys.readouterr()
    ask(seeds=(0, 1), steps=everything)
    assert calls == []
    assert (
        f"KEPT cup.seed1: scored at {Record.read(tmp_path / 'records' / 'cup.json').commit}"
        in capsys.readouterr().out
    )
    (tmp_path / "records" / "cup.json").unlink()
    ask(seeds=(0, 1), steps=everything)
    assert [words[:2] for words in calls] == [["eval", str(tmp_path / "out" / "runs" / "cup")]]


def test_a_failed_piece_does_not_stop_the_others(data, tmp_path, program, ask):
    program.fails = lambda words: words[0] == "eval" and "cup" in words[1]
    with pytest.raises(Exception, match=r"failed.*: cup\."):
        ask(scenes=("cup", "chair"))
    assert (tmp_path / "records" / "chair.json").is_file()


def test_no_scene_at_all_is_an_error(data, tmp_path, ask):
    with pytest.raises(Exception, match="None of gone"):
        ask(scenes=("gone",))


def test_variants_share_phase_one_and_nothing_else(data, tmp_path, calls, ask):
    ask(scenes=("chair",))
    source, run = RunFolder(tmp_path / "out" / "runs" / "chair"), RunFolder(tmp_path / "variant")
    share_phase_one(source, run)
    assert run.config("decompose") == source.config("decompose")
    assert run.asset_file.is_file()
    assert not run.model_folder.exists()


def test_a_shared_phase_one_follows_a_scene_that_has_moved(data, tmp_path, calls, ask):
    ask(scenes=("chair",))
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


def test_every_kind_of_lessons_is_another_phase_two_after_all_usual_ones(
    data, tmp_path, program, calls, hdris, ask
):
    program.true_objects.add("chair")
    ask(hdri=hdris)
    usual, second = calls[:5], calls[5:]
    assert [words[0] for words in usual] == ["train", "eval", "eval", "train", "eval"]
    assert [words[0] for words in second] == ["distill", "eval"] * 3 * 2
    places = ["photos-alone", "re-rendered-alone", "with-HDRIs"]
    runs = [
        tmp_path / "out" / "variants" / f"{name}.lessons.{kind}"
        for name in ("chair", "cup")
        for kind in places
    ]
    assert [Path(words[1]) for words in second[::2]] == [Path(words[1]) for words in second[1::2]] == runs
    assert [words[words.index("--distill.lessons") + 1] for words in second[0:4:2]] == [
        "teacher",
        "synthetic",
    ]
    assert second[4][second[4].index("--hdri") + 1] == str(hdris)
    assert all(words[words.index("--scene") + 1].startswith(str(data)) for words in second)
    assert second[1][second[1].index("--methods") + 1 :] == ["probe-net+optimize", "probe-net", "probe-mlp"]
    page = (tmp_path / "R.md").read_text()
    assert "| chair | probe-net | with HDRIs |" in page
    assert "630 |" in page.split("## Seconds")[1]  # of the usual training
    calls.clear()
    ask(hdri=hdris)
    assert calls == []
    ask()
    assert "| chair | probe-net | with HDRIs |" in (tmp_path / "R.md").read_text()  # what is known stays


def test_the_papers_preset_has_no_other_lessons(data, tmp_path, calls, ask):
    ask(preset=Preset.PAPER)
    assert [words[0] for words in calls] == ["train", "eval"] * 2


def test_failed_lessons_stop_nothing_and_go_on_next_time(data, tmp_path, program, calls, hdris, ask):
    program.fails = lambda words: words[0] == "distill" and "--hdri" in words
    with pytest.raises(Exception, match=r"failed.*: cup\.lessons\.with-HDRIs training, chair\.lessons"):
        ask(scenes=("cup", "chair"), hdri=hdris)
    program.fails = lambda words: False
    assert (tmp_path / "records" / "chair.lessons.photos-alone.json").is_file()
    calls.clear()
    ask(scenes=("cup", "chair"), hdri=hdris)
    assert [words[0] for words in calls] == ["distill", "eval"] * 2


def test_hdris_that_cannot_serve_are_refused_before_any_training(data, tmp_path, calls, hdris, ask):
    with pytest.raises(InputError, match="no \\.exr or \\.hdr"):
        ask(hdri=data)
    with pytest.raises(ConfigError, match="--preset paper"):
        ask(hdri=hdris, preset=Preset.PAPER)
    assert calls == []


def test_no_folder_of_the_machine_is_on_the_pages_or_in_the_records(data, tmp_path, calls, hdris, ask):
    ask(hdri=hdris, steps=(*Step,))
    cup = Record.read(tmp_path / "records" / "cup.json")
    assert cup.command.startswith("lightprobe eval RUNS/cup --scene DATA/real/cup --slow")
    page = (tmp_path / "R.md").read_text()
    assert (
        "lightprobe eval FOLDER/variants/chair.lessons.with-HDRIs --scene DATA/chair --methods probe-net"
        in page
    )
    files = [*(tmp_path / "records").iterdir(), tmp_path / "R.md"]
    assert not any(str(tmp_path) in file.read_text() for file in files)


def test_a_record_tells_how_it_was_made(data, tmp_path, calls, ask):
    ask(seeds=(4,), scenes=("chair",), steps=(Step.RUN,))
    record = Record.read(tmp_path / "records" / "chair.json")
    assert (record.seed, record.preset, record.training) == (4, "quick", {"decompose": 630})
    assert record.commit == record.trained
    assert all((record.commit, record.machine, record.threads))
    assert (record.object_verdict["disagreement"], record.object_verdict["trust"]) == (0.04, "good")
    assert record.light_accuracy["spheres"] == [0.05, 0.2, 0.6]
    (tmp_path / "records" / "chair.json").unlink()
    (tmp_path / "out" / "runs" / "chair" / "bench.json").unlink()  # trained by somebody else
    ask(seeds=(4,), scenes=("chair",), steps=(Step.RUN,))
    assert Record.read(tmp_path / "records" / "chair.json").trained == ""


def test_other_seeds_train_the_default_alone_in_runs_of_their_own(data, tmp_path, calls, ask):
    ask(seeds=(0, 1, 2), scenes=("chair",), steps=(Step.RUN, Step.SEEDS))
    runs = tmp_path / "out" / "runs"
    assert [words[0] for words in calls] == ["train", "eval"] * 3
    for place, seed in ((2, 1), (4, 2)):
        train, score = calls[place], calls[place + 1]
        assert train[train.index("-o") + 1] == score[1] == str(runs / f"chair.seed{seed}")
        assert train[train.index("--seed") + 1] == str(seed)
        assert score[score.index("--methods") + 1 :] == ["probe-net"]
    assert "| chair | 0, 1, 2 | 24." in (tmp_path / "R.md").read_text()  # 22, 24 and 26


def test_seeds_wait_for_the_run_that_names_the_default(data, tmp_path, calls, capsys, ask):
    ask(seeds=(0, 1), scenes=("chair",), steps=(Step.SEEDS,))
    assert calls == []
    assert "SKIPPED chair.seed1: the scene's run has no numbers yet" in capsys.readouterr().out


@pytest.mark.parametrize("step", [Step.LESSONS, Step.LOSSES])
def test_other_second_phases_wait_for_the_first(data, calls, capsys, ask, step):
    ask(scenes=("chair",), steps=(step,))
    assert calls == []
    assert "SKIPPED chair" in capsys.readouterr().out


@pytest.mark.parametrize(
    "asked",
    [
        {"steps": (Step.LOSSES,), "scenes": ("cup",)},
        {"steps": (Step.SEEDS,), "seeds": (0,)},
        {"steps": (Step.LESSONS,), "preset": Preset.PAPER},
    ],
)
def test_a_benchmark_of_nothing_is_refused(data, tmp_path, asked, ask):
    with pytest.raises(ConfigError, match="has nothing to do"):
        ask(**asked)
    assert not (tmp_path / "R.md").exists()


def test_a_true_object_is_scored_anew_with_its_run(data, tmp_path, program, calls, ask):
    program.true_objects.add("chair")
    ask(scenes=("chair",), steps=(Step.RUN,))
    records = tmp_path / "records"
    older = replace(Record.read(records / "chair.oracle.json"), trained="another")
    older.write(records)
    calls.clear()
    program.fails = lambda words: "--oracle-asset" in words
    with pytest.raises(Exception, match="failed"):
        ask(scenes=("chair",), steps=(Step.RUN,))
    assert Record.read(records / "chair.oracle.json") == older  # until there is a new one
    program.fails = lambda words: False
    for _ in range(2):
        ask(scenes=("chair",), steps=(Step.RUN,))
    assert ["--oracle-asset" in words for words in calls] == [True]
    assert Record.read(records / "chair.oracle.json").trained == Record.read(records / "chair.json").trained
    (records / "chair.json").unlink()
    calls.clear()
    ask(scenes=("chair",), steps=(Step.RUN,))
    assert ["--oracle-asset" in words for words in calls] == [False, True]


def test_the_paper_s_settings_get_a_run_of_their_own_that_says_how_long_it_was(data, tmp_path, calls, ask):
    ask(scenes=("chair",), steps=(Step.RUN, Step.PAPER), paper_iterations=(1500, 20))
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
        ask(scenes=("chair",), steps=(Step.PAPER,), paper_iterations=(9, 9))


def test_the_paper_s_options_are_its_own_where_nothing_is_cut():
    options, iterations = paper_options(10**6, 10**6)
    paper = settings(Preset.PAPER)
    assert options[:2] == ("--preset", "paper")
    given = dict(zip(options[2::2], options[3::2], strict=True))
    for option, value in given.items():
        section, _, name = option.removeprefix("--").partition(".")
        owner = getattr(paper, section)
        assert getattr(owner, name.replace("-", "_")) == int(value)
    assert iterations == "40 000 + 30 000"


def test_records_of_other_settings_are_not_taken_for_these(data, tmp_path, calls, ask):
    ask(scenes=("chair",), steps=(Step.RUN,))
    with pytest.raises(ConfigError, match=r"chair\.json was made with seed 0, not 5"):
        ask(seeds=(5,), scenes=("cup", "chair"), steps=(Step.RUN,))
    assert len(calls) == 2  # and the cup was not begun
    for name in ("chair.oracle", "chair.lessons.photos-alone", "chair.loss.L2.seed5"):
        (tmp_path / "records" / f"{name}.json").write_bytes(
            (tmp_path / "records" / "chair.json").read_bytes()
        )
        (tmp_path / "records" / "chair.json").unlink()
        with pytest.raises(ConfigError, match=r"was made with seed 0, not 5"):
            ask(seeds=(5,), scenes=("cup", "chair"), steps=tuple(Step))
        (tmp_path / "records" / f"{name}.json").rename(tmp_path / "records" / "chair.json")
    assert len(calls) == 2


def test_finished_runs_of_other_settings_are_not_scored_as_these(data, tmp_path, calls, ask):
    ask(scenes=("chair",), steps=(Step.RUN, Step.PAPER), paper_iterations=(1500, 20))
    made = len(calls)
    for record in (tmp_path / "records").glob("*.json"):
        record.unlink()  # as their sentence says
    for given, told in (
        ({"seeds": (5,)}, "--seed 0, not 5"),
        ({"preset": Preset.STANDARD}, "--preset quick, not standard"),
        ({"steps": (Step.PAPER,), "paper_iterations": (900, 20)}, "pass1-iterations 1500, not 900"),
        ({"steps": (Step.PAPER,), "paper_iterations": (1500, 9)}, "distill.steps 20, not 9"),
    ):
        with pytest.raises(ConfigError, match=rf"was trained with .*{told}"):
            ask(**{"scenes": ("chair",), "steps": (Step.RUN,), **given})
    run = RunFolder(tmp_path / "out" / "runs" / "chair")
    second = {"seed": 0, **asdict(replace(settings(Preset.QUICK).distill, sphere_steps=7))}
    for section, changed, told in (
        ("distill", second, r"--distill\.sphere-steps 7 as well"),
        ("distill", {**second, "seed": 5}, "--seed 0 and 5, not 0"),
    ):
        before = run.config(section)
        run.restart(section, outputs=())
        run.record_config(section, changed)
        with pytest.raises(ConfigError, match=told):
            ask(scenes=("chair",), steps=(Step.RUN,))
        run.restart(section, outputs=())
        run.record_config(section, before)
    assert len(calls) == made
    assert not list((tmp_path / "records").glob("*.json"))


def test_the_pages_are_written_from_records_alone(data, tmp_path, calls, ask):
    ask(scenes=("chair",), steps=(Step.RUN,))
    before = (tmp_path / "R.md").read_text()
    calls.clear()
    page = tmp_path / "again" / "R.md"
    write_pages(Tables(tmp_path / "records", page, page.with_name("paper-tables.md")), ("chair",))
    assert page.read_text() == before
    assert page.with_name("paper-tables.md").is_file()
    (tmp_path / "empty").mkdir()
    for folder in ("no", "empty"):
        with pytest.raises(ConfigError, match="--records"):
            write_pages(Tables(tmp_path / folder, page))
    assert page.read_text() == before


@pytest.mark.parametrize(
    "wrong",
    [
        {"seeds": ()},
        {"seeds": (1, 1)},
        {"seeds": (-1,)},
        {"paper_iterations": (5,)},
        {"paper_iterations": (0, 5)},
        {"steps": (Step.PAPER,)},
        {"preset": Preset.PAPER, "paper_iterations": (5, 5)},
        {"slow_photos": 0},
    ],
)
def test_options_that_make_no_sense_are_refused_before_any_training(data, tmp_path, calls, wrong, ask):
    with pytest.raises(ConfigError):
        ask(**wrong)
    assert calls == []


def test_options_of_the_variants_exist():
    for options in (*LOSSES.values(), *LESSONS.values()):
        for option in options:
            if option.startswith("--"):
                name = option.removeprefix("--distill.").removeprefix("no-").replace("-", "_")
                assert name in DistillConfig.__dataclass_fields__

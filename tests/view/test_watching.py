"""What the page is told of a training is what its run folder records."""

import json

import pytest

from lightprobe.core.run import RunFolder
from lightprobe.core.timings import PhaseTiming, write_timing
from lightprobe.models import LightAccuracy, ObjectVerdict
from lightprobe.view import watching
from lightprobe.view.watching import TrainingWatch, evaluation_of, log_tail, newest_record, read_records
from tests.report.pages import evaluated_run
from tests.view.finished_run import begun_run


def test_records_are_read_from_where_the_page_left_off(tmp_path):
    path = tmp_path / "metrics.jsonl"
    assert read_records(path, 0) == ([], 0, 0)
    line = json.dumps({"phase": "decompose", "step": 1, "loss": 0.5}) + "\n"
    path.write_text(
        line + "damaged\n" + '{"phase": "other", "step": 2}\n[]\n' + line[:-1].replace("1,", "9,")
    )
    records, end, start = read_records(path, 0)
    assert ([record["step"] for record in records], start) == ([1], 0)  # the last line is not whole yet
    with open(path, "a") as file:
        file.write("\n")
    assert [record["step"] for record in read_records(path, end)[0]] == [9]
    assert newest_record(path) == ("decompose", 9)
    path.write_text(line)
    assert read_records(path, end)[1:] == (len(line), 0)  # begun anew: read from the start


def test_the_time_left_follows_the_speed_that_was_seen(tmp_path, monkeypatch):
    run, now = begun_run(tmp_path), [100.0]
    monkeypatch.setattr(watching.time, "monotonic", lambda: now[0])
    watch = TrainingWatch(run)
    first = watch.state(0)
    assert (first["running"], first["seconds_left"]) == (True, None)
    assert first["phases"][0]["stages"] == {"pass1": 4, "pass2": 3, "pass3": 3}
    run.append_metrics("decompose", 4, {"stage": "pass1", "loss": 0.2})
    now[0] += 8
    assert watch.state(first["next"])["seconds_left"] == pytest.approx(6 * 4)  # 6 steps of 4 seconds


def test_the_time_left_of_a_training_just_opened_comes_from_its_checkpoints(tmp_path):
    run = begun_run(tmp_path)
    run.checkpoints.save(2, {}, {})
    write_timing(run.timings_file, "decompose", PhaseTiming(5.0))
    assert TrainingWatch(run).state(0)["seconds_left"] == pytest.approx(8 * 2.5)
    assert run.checkpoints.newest_step() == 2


def test_what_training_says_of_object_and_maps_is_shown_as_soon_as_it_is_known(tmp_path):
    run = begun_run(tmp_path)
    assert TrainingWatch(run).state(0)["verdicts"] == []
    verdict, accuracy = (
        ObjectVerdict(0.04, photos=5),
        LightAccuracy("solve", 24, 0.5, (0.1, 0.2, 0.6), 0.8, 0.9),
    )
    verdict.save(run.verdict_file)
    assert TrainingWatch(run).state(0)["verdicts"] == [verdict.sentence]
    accuracy.save(run.model_folder)
    assert TrainingWatch(run).state(0)["verdicts"] == [verdict.sentence, accuracy.sentence]
    run.verdict_file.write_text("damaged")
    wrong, right = TrainingWatch(run).state(0)["verdicts"]
    assert str(run.verdict_file) in wrong
    assert right == accuracy.sentence


def test_a_run_that_has_just_begun_or_is_damaged_is_no_failure(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    state = TrainingWatch(run).state(0)
    assert state["records"] == []
    run.metrics_file.write_text("damaged")
    assert TrainingWatch(run).state(0)["evaluation"] == {}
    run.record_config("decompose", {"pass1_iterations": "many"})
    assert TrainingWatch(run).state(0)["phases"][0]["stages"] == {}


def test_the_log_is_shown_without_tracebacks(tmp_path):
    (tmp_path / "log.txt").write_text(
        "2026-01-01 00:00:00  begins\nTraceback (most recent call last):\n  File\n"
    )
    assert log_tail(tmp_path / "log.txt") == ["2026-01-01 00:00:00  begins"]


@pytest.mark.parametrize("mean", [[1], "x", 3, True, None, {"psnr": float("nan")}, {"psnr": 10**400}])
def test_scores_that_are_none_are_left_out(tmp_path, mean):
    run = evaluated_run(tmp_path / "run", {"a": 20.0})
    assert evaluation_of(run)["psnr_masked"] == 20
    run.metrics_file.write_text(json.dumps({"mean": mean}))
    assert evaluation_of(run) == {}

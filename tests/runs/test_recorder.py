"""What a phase's training took, over the calls that it was made in."""

import json

import torch

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.run import RunFolder
from lightprobe.core.timings import read_timings
from lightprobe.runs import recorder
from lightprobe.runs.progress import silent
from lightprobe.training import Stage, Training


class Clock:
    """Stands for the module `time`; moved by hand."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


def begun(run: RunFolder) -> recorder.PhaseRecorder:
    return recorder.PhaseRecorder(run, "decompose", Checkpoints(run.checkpoints.folder), silent)


def test_time_is_summed_over_calls_up_to_the_checkpoint_that_the_next_one_went_on_from(tmp_path, monkeypatch):
    run, clock = RunFolder.create(tmp_path / "run"), Clock()
    monkeypatch.setattr(recorder, "time", clock)
    monkeypatch.setattr(recorder, "peak_memory", lambda: 1.5)
    first = begun(run)
    clock.now += 10
    stage = Stage("pass1", 0, 10)
    training = Training("Phase I", {}, 0, (stage,), 5, first.progress(first.step))
    training.save(stage, 5, {"a": torch.zeros(1)})
    kept = read_timings(run.timings_file)["decompose"]
    assert (kept.seconds, kept.memory, kept.finished) == (10, 1.5, False)
    clock.now += 7  # killed: these seconds' steps are made again
    monkeypatch.setattr(recorder, "peak_memory", lambda: 1.25)
    second = begun(run)
    assert second.count == 5
    clock.now += 4
    second.finish()
    whole = read_timings(run.timings_file)["decompose"]
    assert (whole.seconds, whole.memory, whole.finished) == (14, 1.5, True)
    assert "decompose finished in 0:04, 1.25 GiB at most" in run.log_file.read_text()


def test_a_phase_that_begins_without_a_checkpoint_begins_with_no_time(tmp_path, monkeypatch):
    run, clock = RunFolder.create(tmp_path / "run"), Clock()
    monkeypatch.setattr(recorder, "time", clock)
    for _ in range(2):
        last = begun(run)
        clock.now += 3
    last.finish()
    assert read_timings(run.timings_file)["decompose"].seconds == 3


def test_scores_on_held_out_photos_are_records_that_a_resumed_call_does_not_repeat(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    for _ in range(2):
        begun(run).score("pass2", 20.12345, 21.5)
    (line,) = run.metrics_log.read_text().splitlines()
    assert json.loads(line) == {
        "phase": "decompose",
        "step": 0,
        "stage": "pass2",
        "held_out_before": 20.123,
        "held_out": 21.5,
    }

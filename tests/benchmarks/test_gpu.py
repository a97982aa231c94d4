"""Parts that end, fail and hang; the page they make; and the whole command, briefly, on the CPU."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from gpu import boxes
from gpu import page as pages
from gpu.boxes import Outcome, Pace, Setting, pace_rows, run_part
from gpu.checks import marked, summary
from gpu.kernels import TITLES, device_limits, difference, kernel_row
from gpu.page import BOXES, Box, measure, page
from speed.ball import CPU
from speed.kernels import gather_kernels, raster_kernels

TOOL = Path(__file__).parents[2] / "tools" / "measure_gpu.py"
PART = """
import sys, time
from pathlib import Path
folder, part = Path(sys.argv[1]), sys.argv[2]
(folder / f"{part}.rows").write_text("| measured |\\n")
(folder / f"{part}.json").write_text('{"pass1": [3, 10, 0.2, 2]}')
if part == "fails":
    sys.exit("No CUDA device is free.")
if part == "hangs":
    time.sleep(600)
"""


@pytest.fixture
def setting(tmp_path):
    return Setting(tmp_path, "cpu", brief=True)


def command(setting: Setting, part: str) -> list[str]:
    return [sys.executable, "-c", PART, str(setting.folder), part]


@pytest.mark.parametrize(
    ("part", "failure"),
    [
        ("ends", None),
        ("fails", "No CUDA device is free."),
        ("hangs", "stopped after 2 s, the time it was given"),
    ],
)
def test_what_a_part_had_measured_stays_whatever_becomes_of_it(setting, part, failure):
    outcome = run_part(command(setting, part), part, setting, 2.0 if part == "hangs" else 60.0)
    assert outcome.failure == failure
    assert outcome.rows == ["| measured |"]
    assert outcome.state == {"pass1": [3, 10, 0.2, 2]}
    assert outcome.seconds < 60


def test_parts_share_the_time_and_one_that_fails_costs_the_others_nothing(setting, monkeypatch):
    given = {}

    def run(command, part, setting, limit):
        given[part] = limit
        return Outcome([f"| {part} |"], {}, 30.0, "it broke." if part == "b" else None)

    monkeypatch.setattr(pages, "run_part", run)
    boxes = tuple(Box(name, name.upper(), 1.0, "About.") for name in "abc")
    found = measure(setting, 3.0, boxes)
    assert given == {"a": 60.0, "b": 90.0, "c": 120.0}  # what the others left over
    text = page(setting, found, "python tools/measure_gpu.py", 90.0, boxes)
    assert "**Failed**: it broke. What" in text
    assert all(f"| {name} |" in text for name in "abc")
    none = measure(setting, 0.0, boxes)
    assert {outcome.failure for outcome in none.values()} == {"no time was left for it"}


def test_the_page_says_what_it_is_not(setting):
    text = page(
        setting, {box.part: Outcome([], {}, 1.0) for box in BOXES}, "python tools/measure_gpu.py", 60.0
    )
    for words in (
        "**No GPU was measured**",
        "**A brief measurement**",
        "- commit: ",
        "- machine: ",
        "- seed: 0",
    ):
        assert words in text
    assert "left out" not in text
    assert sum(box.minutes for box in BOXES) <= 25
    some = page(
        setting, {BOXES[0].part: Outcome([], {}, 1.0)}, "python tools/measure_gpu.py", 60.0, BOXES[:1]
    )
    assert f"- left out: {BOXES[1].title}, " in some


def test_a_setting_survives_the_command_line(setting):
    assert Setting.of_words(setting.words()) == setting


def test_pace_is_written_down_and_told(setting):
    pace = Pace("standard", setting)
    for step in (1, 2, 3):
        pace.step("pass1", step, 3)
    assert setting.state_file("standard").is_file()
    assert pace_rows({"pass1": [3, 10, 0.2, 2]})[-1] == "| pass1 | 3 | 10 | 100.0 | 1 |"
    assert pace_rows({}) == []


def test_steps_told_at_once_took_no_time_of_their_own(setting, monkeypatch):
    now = iter([10.0, 10.001, 12.0, 12.001])
    pace = Pace("standard", setting)
    monkeypatch.setattr(boxes.time, "perf_counter", lambda: next(now))
    for step in (1, 2, 3, 4):
        pace.step("pass1", step, 100)
    done, steps, seconds, timed = json.loads(setting.state_file("standard").read_text())["pass1"]
    assert (done, steps, timed) == (3, 100, 1)
    assert seconds == pytest.approx(2.0)


def test_the_tests_that_need_a_gpu_are_found():
    places = marked(TOOL.parents[1] / "tests")
    assert "tests/kernels" in places
    assert "tests/cli/test_cuda.py" in places
    assert "tests/tools/test_measure_gpu.py" not in places


def test_failed_tests_are_named():
    rows = summary("..F\nFAILED tests/a.py::test_b - assert 1\n1 failed, 2 passed in 3s\n")
    assert rows == [
        "`pytest -m cuda`: 1 failed, 2 passed in 3s",
        "",
        "- FAILED tests/a.py::test_b - assert 1",
    ]


@pytest.mark.slow
def test_a_kernel_is_held_against_the_limit_and_the_cpu():
    limits = device_limits(CPU, brief=True)
    assert limits.copy > 1e8
    for kernel in (*gather_kernels(64), *raster_kernels()):
        row = kernel_row(kernel, kernel, CPU, limits)
        assert row.count("|") == len(TITLES) + 1
        assert row.endswith("| 0.0e+00 |")
    assert difference(torch.tensor([1, 2, 3, 4]), torch.tensor([1, 2, 0, 4])) == 0.25
    assert difference(torch.tensor([3.0, 4.0]), torch.tensor([0.0, 4.0])) == 0.75


@pytest.mark.long
def test_the_command_runs_briefly_on_a_cpu(tmp_path):
    words = [
        sys.executable,
        str(TOOL),
        "--device",
        "cpu",
        "--brief",
        "--minutes",
        "60",
        "-o",
        str(tmp_path / "page.md"),
    ]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    text = (tmp_path / "page.md").read_text()
    assert "Failed" not in text
    for box in BOXES:
        assert f"## {box.title}" in text
    trained = [f"| {name}, seed 0, on cpu |" for name in ("demo", "standard")]
    for row in ("| rasterise, ", "| probe-net+optimize | cpu | ", *trained):
        assert row in text
    assert not (tmp_path / "benchmarks").exists()

"""A few moments of the fifty, and that a command which leaves something else is found out."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tests.kills.__main__ import Result, page
from tests.kills.commands import contents, leftovers
from tests.kills.program import Fault, Moment

ROOT = Path(__file__).parents[2]


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="children are forked, as Linux does it safely")
def test_export_ends_with_the_same_bits_after_every_fault(tmp_path):
    words = [sys.executable, "-m", "tests.kills", "--moments", "2", "--commands", "export"]
    threads = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    written = tmp_path / "page.md"
    done = subprocess.run(
        [*words, "--page", str(written)], cwd=ROOT, env={**os.environ, **threads}, capture_output=True
    )
    assert done.returncode == 0, (done.stdout + done.stderr).decode()
    assert "| export | 2 of 2 | 1 of 1 | 1 of 1 | 1 of 1 |" in written.read_text()


def test_what_was_timed_is_left_out_of_what_is_compared(tmp_path):
    for name, seconds in (("a", 1.5), ("b", 2.5)):
        (tmp_path / name).mkdir()
        numbers = json.dumps({"photos": [{"psnr": 30.0, "seconds": seconds}]})
        (tmp_path / name / "metrics.json").write_text(numbers)
        (tmp_path / name / "log.txt").write_text(name)
        (tmp_path / name / "map.exr").write_bytes(b"map")
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    (tmp_path / "b" / "map.exr").write_bytes(b"Map")
    assert contents(tmp_path / "a") != contents(tmp_path / "b")
    assert leftovers(tmp_path) == []
    (tmp_path / "a" / ".partial-lightprobe-abcd_123").touch()
    assert leftovers(tmp_path) == [".partial-lightprobe-abcd_123"]


def test_the_record_counts_and_names_what_went_wrong():
    kinds = (Moment(Fault.KILL, change=3), Moment(Fault.KILL, seconds=0.5), Moment(Fault.LIMIT, size=9))
    moments = [str(moment) for moment in kinds]
    assert moments == ["kill -9 at change 3", "kill -9 at 0.50 s", "writes end at 9 bytes"]
    first, second = (Result("predict", moment, "kill -9") for moment in moments[:2])
    text = page([first, replace(second, fault="other bits")], "command")
    assert "| predict | 1 of 2 |" in text
    assert "- predict, kill -9 at 0.50 s: other bits" in text

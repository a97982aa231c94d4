"""Equal seeds leave equal files, whether the program is killed on the way, compiles its kernels or finds them."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.toy_scene import TINY, TINY_DISTILL, write_toy_scene

KILLS = 4  # `make kills` tries many more moments


def start(scene: Path, run: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", "lightprobe", "train", str(scene), "-o", str(run), *TINY, *TINY_DISTILL]
    threads = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    environment = {**os.environ, **threads, "NUMBA_CACHE_DIR": str(scene.parent / "kernels")}
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment)


def finish(scene: Path, run: Path) -> float:
    """Train to the end and return the seconds it took."""
    began = time.monotonic()
    process = start(scene, run)
    assert process.wait() == 0, process.stderr.read().decode()
    return time.monotonic() - began


def contents(run: Path) -> dict[str, bytes]:
    """Every file of a run but the log with its times of day, and the record of what was timed."""
    files = {str(p.relative_to(run)): p.read_bytes() for p in sorted(run.rglob("*")) if p.is_file()}
    return {name: data for name, data in files.items() if name not in ("log.txt", "timings.json", ".lock")}


def assert_same(run: Path, other: Path) -> None:
    ours, theirs = contents(run), contents(other)
    assert ours.keys() == theirs.keys()
    assert [name for name in ours if ours[name] != theirs[name]] == []


def killed_runs(scene: Path, folder: Path, seconds: float) -> list[Path]:
    """Train, killed KILLS times, and return the runs begun: a new one each time that training got through."""
    moments, runs = random.Random(7), [folder / "run-0"]
    for _ in range(KILLS):
        if (runs[-1] / "model" / "config.json").exists():  # it got through before the last kill
            runs.append(folder / f"run-{len(runs)}")
        process = start(scene, runs[-1])
        time.sleep(moments.uniform(0.3, 0.8) * seconds)
        process.send_signal(signal.SIGKILL)
        process.wait()
    return runs


@pytest.mark.slow
def test_a_run_killed_again_and_again_ends_with_the_same_bits(tmp_path):
    scene = write_toy_scene(tmp_path / "scene")
    finish(scene, tmp_path / "compiling")  # its kernels into an empty cache
    seconds = finish(scene, tmp_path / "whole")
    assert_same(tmp_path / "compiling", tmp_path / "whole")

    for run in killed_runs(scene, tmp_path / "killed", seconds):
        finish(scene, run)
        assert_same(run, tmp_path / "whole")

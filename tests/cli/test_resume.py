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

KILLS = 10


def start(scene: Path, run: Path) -> subprocess.Popen:
    code = "import sys; from lightprobe.cli.main import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "train", str(scene), "-o", str(run), *TINY, *TINY_DISTILL]
    kernels = {**os.environ, "NUMBA_CACHE_DIR": str(scene.parent / "kernels")}
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=kernels)


def finish(scene: Path, run: Path) -> float:
    """Train to the end and return the seconds it took."""
    began = time.monotonic()
    process = start(scene, run)
    assert process.wait() == 0, process.stderr.read().decode()
    return time.monotonic() - began


def contents(run: Path) -> dict[str, bytes]:
    """Every file of a run but the log with its times of day."""
    files = {str(p.relative_to(run)): p.read_bytes() for p in sorted(run.rglob("*")) if p.is_file()}
    return {name: data for name, data in files.items() if name not in ("log.txt", ".lock")}


def assert_same(run: Path, other: Path) -> None:
    ours, theirs = contents(run), contents(other)
    assert ours.keys() == theirs.keys()
    assert [name for name in ours if ours[name] != theirs[name]] == []


@pytest.mark.slow
def test_a_run_killed_again_and_again_ends_with_the_same_bits(tmp_path):
    scene = write_toy_scene(tmp_path / "scene")
    finish(scene, tmp_path / "compiling")  # its kernels into an empty cache
    seconds = finish(scene, tmp_path / "whole")
    assert_same(tmp_path / "compiling", tmp_path / "whole")
    moments, runs = random.Random(0), [tmp_path / "killed-0"]
    for _ in range(KILLS):
        if (runs[-1] / "model" / "config.json").exists():  # it got through before the last kill
            runs.append(tmp_path / f"killed-{len(runs)}")
        process = start(scene, runs[-1])
        time.sleep(moments.uniform(0.3, 0.8) * seconds)
        process.send_signal(signal.SIGKILL)
        process.wait()
    for run in runs:
        finish(scene, run)
        assert_same(run, tmp_path / "whole")

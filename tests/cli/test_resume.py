"""Equal seeds leave equal files, whether the program is killed on the way, compiles its kernels or finds
them.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.run import RunFolder
from tests.toy_scene import TINY, TINY_DISTILL, write_toy_scene

# Killed once these checkpoints hold this step, in each pass and in Phase II; `make kills` tries many more
# moments.
KILLED_AT = (("checkpoints", 5), ("checkpoints", 17), ("checkpoints", 25), ("model_checkpoints", 5))
_LONG = 300.0  # seconds without a checkpoint after which something hangs


def start(scene: Path, run: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", "lightprobe", "train", str(scene), "-o", str(run), *TINY, *TINY_DISTILL]
    threads = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    environment = {**os.environ, **threads, "NUMBA_CACHE_DIR": str(scene.parent / "kernels")}
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment)


def finish(scene: Path, run: Path) -> None:
    """Train to the end."""
    process = start(scene, run)
    said = process.communicate()[1].decode()
    assert process.returncode == 0, said


def kill(scene: Path, run: Path, checkpoints: Checkpoints, step: int) -> None:
    """Train until there is a checkpoint of at least `step`, and no longer."""
    process, began = start(scene, run), time.monotonic()
    while (checkpoints.newest_step() or 0) < step:
        assert process.poll() is None, process.stderr.read().decode()
        assert time.monotonic() - began < _LONG
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()


def contents(run: Path) -> dict[str, bytes]:
    """Every file of a run but the log with its times of day, and the record of what was timed."""
    files = {str(p.relative_to(run)): p.read_bytes() for p in sorted(run.rglob("*")) if p.is_file()}
    return {name: data for name, data in files.items() if name not in ("log.txt", "timings.json", ".lock")}


@pytest.mark.long
def test_a_run_killed_again_and_again_ends_with_the_same_bits(tmp_path):
    scene = write_toy_scene(tmp_path / "scene")
    finish(scene, tmp_path / "whole")  # which compiles the kernels that the other finds

    killed = tmp_path / "killed"
    for checkpoints, step in KILLED_AT:
        kill(scene, killed, getattr(RunFolder(killed), checkpoints), step)
        assert not (killed / "model" / "config.json").exists()  # which ends a run
    finish(scene, killed)
    ours, whole = contents(killed), contents(tmp_path / "whole")
    assert ours.keys() == whole.keys()
    assert [name for name in ours if ours[name] != whole[name]] == []

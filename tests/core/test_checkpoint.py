import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from lightprobe.core.checkpoint import Checkpoints, load_metadata, load_tensors, save_tensors
from lightprobe.core.errors import InputError, ResourceError


def test_tensors_and_metadata_round_trip(tmp_path):
    base = torch.arange(12, dtype=torch.float32).reshape(3, 4)
    tensors = {"view": base[1:], "turned": base.T, "index": torch.tensor([1, 2]), "none": torch.zeros(0, 3)}
    save_tensors(tmp_path / "a.safetensors", tensors, {"unit": "metre", "levels": [1, 2]})
    loaded = load_tensors(tmp_path / "a.safetensors")
    assert loaded.keys() == tensors.keys()
    assert all(torch.equal(loaded[name], tensors[name]) for name in tensors)
    assert load_metadata(tmp_path / "a.safetensors") == {"unit": "metre", "levels": [1, 2]}


def test_equal_content_gives_equal_bytes(tmp_path):
    tensors = {name: torch.full((3,), float(i)) for i, name in enumerate("cab")}
    save_tensors(tmp_path / "a", tensors, {"x": 1, "y": 2})
    save_tensors(tmp_path / "b", dict(reversed(tensors.items())), {"y": 2, "x": 1})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("kept", [None, 0, 20, -8])
def test_damaged_or_missing_file_is_an_input_error(tmp_path, kept):
    path = tmp_path / "weights.safetensors"
    if kept is not None:
        save_tensors(path, {"w": torch.ones(100)})
        path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"weights\.safetensors"):
        load_tensors(path)
    with pytest.raises(InputError, match=r"weights\.safetensors"):
        load_metadata(path)


def test_the_last_two_checkpoints_are_kept_and_the_newest_returned(tmp_path):
    checkpoints = Checkpoints(tmp_path / "checkpoints")
    assert checkpoints.latest() is None
    for step in (100, 200, 1500):
        checkpoints.save(step, {"w": torch.full((2,), float(step))}, {"best": step / 2})
    assert sorted(os.listdir(checkpoints.folder)) == ["step-000000200", "step-000001500"]
    step, tensors, state = checkpoints.latest()
    assert (step, state) == (1500, {"best": 750.0})
    assert torch.equal(tensors["w"], torch.full((2,), 1500.0))


def test_a_damaged_checkpoint_is_passed_over(tmp_path):
    checkpoints = Checkpoints(tmp_path)
    checkpoints.save(1, {"w": torch.ones(4)}, {})
    checkpoints.save(2, {"w": torch.ones(4)}, {})
    (tmp_path / "step-000000002" / "tensors.safetensors").write_bytes(b"cut")
    assert checkpoints.latest()[0] == 1
    checkpoints.save(2, {"w": torch.zeros(4)}, {})
    assert checkpoints.latest()[0] == 2


def test_a_failed_save_leaves_the_last_checkpoint_and_no_rubbish(tmp_path, monkeypatch):
    checkpoints = Checkpoints(tmp_path)
    checkpoints.save(1, {"w": torch.ones(4)}, {})

    def full(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ResourceError, match="disk is full"):
        checkpoints.save(2, {"w": torch.ones(4)}, {})
    assert os.listdir(tmp_path) == ["step-000000001"]


WRITER = """
import sys, torch
from lightprobe.core.checkpoint import Checkpoints
checkpoints = Checkpoints(sys.argv[1])
print("ready", flush=True)
for step in range(1, 100000):
    checkpoints.save(step, {"w": torch.full((50000,), float(step))}, {"step": step})
"""


@pytest.mark.slow
def test_kill_at_any_moment_leaves_a_whole_checkpoint(tmp_path):
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    process.stdout.readline()
    time.sleep(0.4)
    process.send_signal(signal.SIGKILL)
    process.wait()
    step, tensors, state = Checkpoints(tmp_path).latest()
    assert state == {"step": step}
    assert torch.equal(tensors["w"], torch.full((50000,), float(step)))
    whole = [p for p in Path(tmp_path).glob("step-*") if len(list(p.iterdir())) == 2]
    assert whole == list(Path(tmp_path).glob("step-*"))

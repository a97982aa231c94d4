import os
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from lightprobe.core import memory
from lightprobe.core.memory import available_bytes, held_bytes, peak_memory, resident_bytes

COUNTED = 0.001  # GiB by which the count of a moment may be off: each core counts for itself, and adds up now and then


def test_the_peak_counts_what_was_held_in_gib_and_never_falls():
    before = peak_memory()
    held = np.ones(3 * 2**27, np.uint8)  # 384 MiB
    grown = peak_memory()
    del held
    assert 0.05 < before < 64
    assert grown >= before - COUNTED
    assert peak_memory() >= max(grown - COUNTED, 0.37)


@pytest.mark.slow
def test_a_process_does_not_count_what_the_one_that_started_it_held():
    held = np.ones(3 * 2**28, np.uint8)  # 768 MiB
    shown = "from lightprobe.core.memory import peak_memory; print(peak_memory())"
    child = subprocess.run([sys.executable, "-c", shown], capture_output=True, text=True, check=True)
    assert len(held) > 0
    assert 0.05 < float(child.stdout) < 0.7


@pytest.mark.parametrize("status", [None, "", "VmHWM:", "VmHWM:\t  unknown kB\n"])
def test_without_such_a_count_the_system_is_asked_for_another(tmp_path, monkeypatch, status):
    monkeypatch.setattr(memory, "_STATUS", str(tmp_path / "status"))
    if status is not None:
        (tmp_path / "status").write_text(status)
    assert 0.05 < peak_memory() < 64


def test_counts_are_in_kilobytes_of_1024_bytes(tmp_path, monkeypatch):
    (tmp_path / "status").write_text("Name:\tpython\nVmHWM:\t  3145728 kB\nVmRSS:\t 99 kB\n")
    monkeypatch.setattr(memory, "_STATUS", str(tmp_path / "status"))
    assert peak_memory() == 3
    assert resident_bytes(1) == 99 * 1024


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it is not told")
def test_a_process_and_a_machine_tell_their_memory():
    assert available_bytes() > 2**24 < resident_bytes(os.getpid())
    assert resident_bytes(2**30) is None


@dataclass(frozen=True)
class Kept:
    first: object
    second: object


def test_shared_memory_counts_once_and_caches_count():
    tensor, array = torch.zeros(1000), np.zeros((10, 10))
    assert held_bytes(tensor) == 4000
    assert held_bytes([tensor[:10], {"a": tensor[20:]}, Kept(tensor, (array, array[2:].T))]) == 4000 + 800
    layer = torch.nn.Linear(8, 4)
    assert held_bytes(layer) == 4 * 36
    layer.cached = torch.zeros(100)
    assert held_bytes(layer) == 4 * 136


def test_circles_and_what_belongs_to_python_end():
    one = Kept([], None)
    one.first.append(one)
    assert held_bytes([one, held_bytes, sys, "text", 5, open, print]) == 0

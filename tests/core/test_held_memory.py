"""What is kept is counted once, however it is reached."""

import os
import sys
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from lightprobe.core.memory import held_bytes, resident_bytes


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


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it is not told")
def test_a_process_tells_its_memory():
    assert resident_bytes(os.getpid()) > 2**24
    assert resident_bytes(2**30) is None

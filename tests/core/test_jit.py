"""Compiled loops without a cache folder, their number of threads, and work in threads."""

import subprocess
import sys
import threading

import numba
import numpy as np
import pytest
import torch

from lightprobe.core import jit
from lightprobe.core.threads import in_threads
from tests.threads import torch_threads


def test_without_a_cache_folder_the_loop_still_compiles(monkeypatch):
    real = numba.njit

    def njit(*function, **options):  # Numba's own modules, imported late, use it without options
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return real(*function, **options)

    monkeypatch.setattr(numba, "njit", njit)

    @jit.compiled()
    def inverse(x):
        return 1 / x

    assert inverse(4.0) == 0.25
    assert inverse(0.0) == np.inf


def test_threads_follow_pytorch_and_the_work():
    with torch_threads(1):
        assert jit.threads(10**9) == numba.get_num_threads() == 1
    with torch_threads(2):
        assert jit.threads(10**9) == numba.get_num_threads() == min(2, numba.config.NUMBA_NUM_THREADS)
        assert jit.threads(1000) == numba.get_num_threads() == 1


def test_arrays_are_contiguous_and_of_one_integer_type():
    values, index = jit.arrays(torch.zeros(4, 3, requires_grad=True).T, torch.arange(5))
    assert values.flags.c_contiguous
    assert values.shape == (3, 4)
    assert index.dtype == np.int32


@pytest.mark.slow
def test_a_compiled_loop_leaves_pytorch_its_number_of_threads():
    """Numba gives OpenMP all cores when it starts its threads, in the first loop of a process."""
    program = (
        "import torch; torch.set_num_threads(1);"
        "from lightprobe.core.jit import threads; threads(10**9); assert torch.get_num_threads() == 1"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_results_come_in_order_from_several_threads(monkeypatch):
    monkeypatch.setattr(torch, "get_num_threads", lambda: 2)
    together = threading.Barrier(2, timeout=20)  # passes only when two work at once

    def work(item: int) -> int:
        together.wait()
        return 10 * item

    assert in_threads(work, range(6)) == [0, 10, 20, 30, 40, 50]


def test_the_first_failure_is_raised():
    def work(item: int) -> int:
        if item > 1:
            raise ValueError(f"item {item}")
        return item

    with pytest.raises(ValueError, match="item 2"):
        in_threads(work, range(5))

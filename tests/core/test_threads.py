"""Work in threads: results in order, the first failure told."""

import threading

import pytest
import torch

from lightprobe.core.threads import in_threads


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

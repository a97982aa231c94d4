"""Processes side by side: what they return, and what they are told about threads."""

import os

from benchmarks.workers import side_by_side


def told(name: str) -> tuple[str, str | None, int]:
    return name, os.environ.get(name), os.getpid()


def test_only_workers_are_told_to_use_one_thread(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    found = sorted(side_by_side(told, [("OMP_NUM_THREADS",), ("NUMBA_NUM_THREADS",)], 1))
    assert [answer[:2] for answer in found] == [("NUMBA_NUM_THREADS", "1"), ("OMP_NUM_THREADS", "1")]
    assert len({answer[2] for answer in found} | {os.getpid()}) == 3  # a process for every call
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "NUMBA_NUM_THREADS" not in os.environ

"""A step is done once, and again when what it depends on has changed or its file is damaged."""

import numpy as np
import pytest

from lightprobe.preparation.cache import Cache, key_of


def test_a_step_is_done_once_for_each_key(tmp_path):
    cache, calls = Cache(tmp_path), []

    def make():
        calls.append(1)
        return {"a": np.arange(3) + len(calls)}

    first = cache.arrays("step", key_of(1, "x"), make)
    assert cache.arrays("step", key_of(1, "x"), make)["a"].tolist() == first["a"].tolist() == [1, 2, 3]
    assert cache.arrays("step", key_of(2, "x"), make)["a"].tolist() == [2, 3, 4]
    (tmp_path / "step.npz").write_bytes(b"cut short")
    assert cache.arrays("step", key_of(2, "x"), make)["a"].tolist() == [3, 4, 5]
    assert len(calls) == 3


def test_a_damaged_step_is_done_again_wherever_it_is_damaged(tmp_path):
    cache = Cache(tmp_path)
    cache.arrays("step", "key", lambda: {"a": np.arange(40)})
    sound = (tmp_path / "step.npz").read_bytes()
    for place in range(0, len(sound), 3):
        (tmp_path / "step.npz").write_bytes(sound[:place] + bytes([sound[place] ^ 0x55]) + sound[place + 1 :])
        assert cache.arrays("step", "key", lambda: {"a": np.arange(40)})["a"].tolist() == list(range(40))


def test_a_step_that_would_fill_the_memory_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("lightprobe.preparation.cache._LARGEST", 1000)
    cache, made = Cache(tmp_path), []
    for _ in range(2):
        cache.arrays("step", "key", lambda: made.append(1) or {"a": np.zeros(1000)})
    assert len(made) == 2


def test_what_fails_leaves_nothing(tmp_path):
    def fail():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Cache(tmp_path).arrays("step", "key", fail)
    assert list(tmp_path.iterdir()) == []

"""The interval in which another seed is expected: how often one falls outside, and what is written beside it."""

import json

import numpy as np
import pytest

import measure_golden
from measure_golden import FILE, intervals, summary


@pytest.mark.slow
def test_another_seed_falls_outside_as_often_as_is_said():
    rng = np.random.default_rng(0)
    outside, count = 0, 3000
    for _ in range(count):
        values = rng.normal(20, 0.5, (9, 2))
        measured = {str(i): {"a": float(v[0]), "b": float(v[1])} for i, v in enumerate(values[:8])}
        expected = intervals(measured, false_alarm=0.1)
        outside += values[8, 0] not in expected["a"] or values[8, 1] not in expected["b"]
    assert 0.08 < outside / count < 0.115  # 0.0975 where the two are independent, with a deviation of .0054


def test_a_spread_needs_three_seeds():
    with pytest.raises(ValueError, match="three"):
        intervals({"1": {"a": 1.0}, "2": {"a": 2.0}})


def test_what_is_stored_is_the_statistics_of_its_seeds():
    stored = json.loads(FILE.read_text())
    assert len(stored["seeds"]) >= 8
    assert "0" not in stored["seeds"]
    assert stored["scores"] == summary(stored["seeds"])


def test_seeds_that_the_file_has_are_kept(tmp_path, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(measure_golden, "small_scene", lambda: None)
    monkeypatch.setattr(measure_golden, "scores", lambda scene, seed: asked.append(seed) or {"a": seed / 2})
    file = tmp_path / "golden.json"
    for words in (["--seeds", "2"], ["--seeds", "4", "--more"]):
        assert measure_golden.main([*words, "--file", str(file)]) == 0
    assert asked == [1, 2, 3, 4]
    assert json.loads(file.read_text())["scores"] == {
        "a": {"n": 4, "mean": 1.25, "sd": pytest.approx(0.6455, abs=1e-4)}
    }
    assert "seed 4" in capsys.readouterr().out

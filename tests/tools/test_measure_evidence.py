"""Which photos share a light, and what the tables say of maps before and after."""

from types import SimpleNamespace

import numpy as np
import pytest

import measure_evidence


def photo(name, light):
    return SimpleNamespace(name=name, truth=SimpleNamespace(environment=light))


def test_photos_are_put_together_by_their_light():
    scene = SimpleNamespace(relight=[photo("a", "sun"), photo("b", "lamp"), photo("c", "sun")])
    found = measure_evidence.photos_of_one_light(scene)
    assert [[one.name for one in photos] for photos in found] == [["a", "c"], ["b"]]


def test_a_row_has_means_ratios_and_how_many_became_worse():
    before = np.array([[0.1, 0.2, 0.4, 20.0, 22.0, 1.0], [0.3, 0.2, 0.4, 22.0, 24.0, 1.0]])
    after = np.array([[0.1, 0.1, 0.4, 21.0, 23.0, 0.5], [0.1, 0.1, 0.4, 23.0, 25.0, 1.1]])
    row = measure_evidence.row("chair", before, after)
    assert row == (
        "| chair | 2 | 0.200/0.200/0.400 → 0.100/0.100/0.400 | "
        "21.0 / 23.0 → 22.0 / 24.0 | 1.000 → 0.800 | "
        "0.800; spheres 0.50/0.50/1.00 | 1 |"
    )


def test_both_tables_end_with_all_photos(monkeypatch, capsys):
    scores = {"spot": 0.4, "chair": 0.2}

    def tables(scene, run):
        table = np.full((2, 6), scores[run.name])
        return SimpleNamespace(background=lambda: (table, 0.5 * table), together=lambda: (table, table))

    monkeypatch.setattr(measure_evidence, "load_scene", lambda path: path)
    monkeypatch.setattr(measure_evidence.Subject, "of", tables)
    measure_evidence.main(["--data", "data", "--runs", "runs", "--scenes", "spot", "chair"])
    rows = [
        line
        for line in capsys.readouterr().out.splitlines()
        if line.startswith(("| spot", "| chair", "| all"))
    ]
    assert [line.split(" | ")[1] for line in rows] == ["2", "2", "4"] * 2
    assert "0.300 → 0.150" in rows[2]
    assert "0.300 → 0.300" in rows[5]


def test_a_photo_of_unknown_light_cannot_be_scored():
    subject = measure_evidence.Subject(None, None, None)
    with pytest.raises(ValueError, match="light of a is not known"):
        subject.scores(None, photo("a", None))

"""Clipped source pixels are counted one by one, and Phase I marks as many."""

import numpy as np
import pytest

import measure_clipping
from lightprobe.core.config.reconstruction import quick
from tests.known_scene import known_scene
from tests.toy_scene import write_toy_scene


def test_every_overlap_counts():
    clipped = np.zeros((6, 6), bool)
    clipped[0, 0] = clipped[3, 2] = True
    assert np.array_equal(measure_clipping.counted(clipped, 2, 2), [[True, False], [True, False]])
    uneven = measure_clipping.counted(clipped, 4, 4)  # of 1.5 pixels each way
    assert np.array_equal(np.argwhere(uneven), [[0, 0], [2, 1]])


def test_the_table_of_a_scene(tmp_path, capsys):
    scene = write_toy_scene(tmp_path / "scene", train=2, test=1)
    measure_clipping.main([str(scene)])
    rows = capsys.readouterr().out.splitlines()[2:]
    assert len(rows) == 3
    for row in rows:
        _, _, _, true, marked, _, _ = (cell.strip() for cell in row.split("|"))
        assert float(marked) == pytest.approx(float(true), abs=0.05)


@pytest.mark.slow
def test_lights_by_marks_and_by_averages(tmp_path, monkeypatch):
    """Lights are found about as well as a smooth ball tells; what is clipped in no photo changes nothing."""
    known, scene = known_scene(tmp_path)
    monkeypatch.setattr(measure_clipping, "true_asset", lambda scene: known.asset)
    average, marked = (row.split("|")[2:-1] for row in measure_clipping.light_rows(scene, quick()))
    assert [row[0].strip() for row in (average, marked)] == ["clipped average", "marked"]
    assert average[1:] == marked[1:]
    assert 0 < float(marked[3]) < 0.5


def test_lights_need_an_object(tmp_path):
    scene = write_toy_scene(tmp_path / "scene", train=2, test=1)
    with pytest.raises(SystemExit, match=r"mesh\.obj"):
        measure_clipping.main([str(scene), "--lights"])


def test_no_scene_is_a_sentence(tmp_path):
    with pytest.raises(SystemExit, match=r"nothing"):
        measure_clipping.main([str(tmp_path / "nothing")])

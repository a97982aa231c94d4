"""The index: rows once, parts whole, and what an earlier call left."""

import pyarrow.parquet as pq
import pytest

from lightprobe.core.errors import InputError
from lightprobe.fleet.index import PhotoIndex, PhotoRow, SceneIndex, SceneRow, State
from lightprobe.fleet.storage import Place


def row(number: int, state: State = State.DONE) -> PhotoRow:
    return PhotoRow(
        number, "run", "photo", state.value, None if state is State.DONE else "No light.", explained=0.5
    )


def test_parts_are_one_table_and_are_gone_on_with(tmp_path):
    place = Place.of(tmp_path)
    index = PhotoIndex(place, 5)
    index.add([row(3), row(1, State.FAILED)])
    assert not (tmp_path / "index").exists()
    index.flush()
    again = PhotoIndex(place, 5)
    assert again.done.tolist() == [False, True, False, True, False]
    assert (again.count, again.failed) == (2, 1)
    again.add([row(0)])
    again.flush()
    table = pq.read_table(tmp_path / "index").to_pydict()
    assert sorted(table["row"]) == [0, 1, 3]
    parts = sorted(path.name for path in (tmp_path / "index").iterdir())
    assert parts == ["part-000000.parquet", "part-000001.parquet"]


def test_parts_are_written_when_time_has_passed(tmp_path):
    PhotoIndex(Place.of(tmp_path), 5).add([row(0)])
    assert not (tmp_path / "index").exists()
    PhotoIndex(Place.of(tmp_path), 5, every=0.0).add([row(0), row(1)])
    assert len(pq.read_table(tmp_path / "index")) == 2


def test_a_row_is_taken_once(tmp_path):
    index = PhotoIndex(Place.of(tmp_path), 5)
    index.add([row(2)])
    with pytest.raises(ValueError, match="already"):
        index.add([row(2)])


def test_failures_are_forgotten_and_the_rest_is_kept(tmp_path):
    index = PhotoIndex(Place.of(tmp_path), 5)
    index.add([row(0), row(1, State.FAILED)])
    index.flush()
    index.add([row(2, State.FAILED)])
    index.flush()
    again = PhotoIndex(Place.of(tmp_path), 5)
    again.forget_failures()
    assert (again.count, again.failed) == (1, 0)
    kept = pq.read_table(tmp_path / "index").to_pylist()
    assert [one["row"] for one in kept] == [0]
    assert kept[0]["explained"] == 0.5
    again.add([row(1), row(2)])
    again.flush()
    assert sorted(pq.read_table(tmp_path / "index")["row"].to_pylist()) == [0, 1, 2]


def test_damaged_parts_and_those_of_another_table_are_told(tmp_path):
    index = PhotoIndex(Place.of(tmp_path), 5)
    index.add([row(4)])
    index.flush()
    with pytest.raises(InputError, match="does not have"):
        PhotoIndex(Place.of(tmp_path), 4)
    part = tmp_path / "index" / "part-000000.parquet"
    part.write_bytes(part.read_bytes()[:100])
    with pytest.raises(InputError, match="part-000000"):
        PhotoIndex(Place.of(tmp_path), 5)
    (tmp_path / "index" / "part-x.parquet").write_bytes(b"")
    with pytest.raises(InputError, match="no part"):
        PhotoIndex(Place.of(tmp_path), 5)


def test_a_scene_has_its_newest_row(tmp_path):
    index = SceneIndex(Place.of(tmp_path))
    index.put(SceneRow("cup", "runs/cup", State.FAILED.value, "No photos."))
    index.put(SceneRow("vase", "runs/vase", State.DONE.value, phase1_seconds=2.0, photos=7))
    index.put(SceneRow("cup", "runs/cup", State.DONE.value))
    assert SceneIndex(Place.of(tmp_path)).rows == index.rows
    assert pq.read_table(tmp_path / "index.parquet")["scene"].to_pylist() == ["cup", "vase"]

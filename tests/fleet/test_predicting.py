"""Fleets of predictions: a row for each photo, whatever dies; the same files wherever they go."""

import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lightprobe.core.errors import ConfigError, LockedError
from lightprobe.core.files import locked_file
from lightprobe.fleet.executor import Needs
from lightprobe.fleet.index import PhotoRow
from lightprobe.fleet.predicting import map_place, predict_fleet
from lightprobe.fleet.storage import Place
from lightprobe.jobs import ChosenFiles, PredictRequest, Session, predict_photos
from tests.fleet.stub import Stub
from tests.view.finished_run import finished_run


def done(chunk):
    """Pretend that all photos of a task have maps."""
    return [PhotoRow(row.row, row.run, row.photo, "done") for row in chunk.rows]


def table_of(folder, count):
    path = folder / "photos.parquet"
    pq.write_table(pa.table({"run": ["r"] * count, "photo": [f"{i}.png" for i in range(count)]}), path)
    return path


def index_of(output):
    return sorted(pq.read_table(output / "index").to_pylist(), key=lambda row: row["row"])


def test_every_photo_has_one_row_though_one_kills_its_worker(tmp_path):
    executor = Stub(done, lose=lambda chunk: any(row.photo == "7.png" for row in chunk.rows))
    found = predict_fleet(table_of(tmp_path, 20), tmp_path / "out", executor, chunk=5, needs=Needs(retries=1))
    assert (found.photos, found.done, found.failed) == (20, 19, 1)
    rows = index_of(tmp_path / "out")
    assert [row["row"] for row in rows] == list(range(20))
    assert [row["photo"] for row in rows if row["state"] == "failed"] == ["7.png"]
    assert "died in 2 tries" in rows[7]["reason"]
    assert [len(chunk.rows) for chunk in executor.tasks] == [5, 5, 5, 5, 1, 1, 1, 1, 1]


def test_the_same_call_goes_on(tmp_path):
    table, out = table_of(tmp_path, 20), tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        predict_fleet(table, out, Stub(done, stop=2), chunk=5)
    assert len(index_of(out)) == 10
    second = Stub(done)
    assert predict_fleet(table, out, second, chunk=5).done == 20
    assert len(second.tasks) == 2
    third = Stub(done)
    assert predict_fleet(table, out, third, chunk=5).done == 20
    assert third.tasks == []


def test_failures_are_tried_again_when_that_is_asked_for(tmp_path):
    table, out = table_of(tmp_path, 6), tmp_path / "out"
    assert predict_fleet(table, out, Stub(done, lose=lambda _: True), chunk=3).failed == 6
    idle = Stub(done)
    predict_fleet(table, out, idle, chunk=3)
    assert idle.tasks == []
    assert predict_fleet(table, out, Stub(done), chunk=3, retry_failed=True).done == 6
    assert len(index_of(out)) == 6


def test_progress_counts_photos(tmp_path):
    said = []
    predict_fleet(
        table_of(tmp_path, 4),
        tmp_path / "out",
        Stub(done),
        chunk=2,
        on_progress=lambda *words: said.append(words),
    )
    assert said == [("photos", 0, 4), ("photos", 2, 4, ""), ("photos", 4, 4, "")]


def test_a_folder_belongs_to_its_table_and_options(tmp_path):
    out = tmp_path / "out"
    predict_fleet(table_of(tmp_path, 4), out, Stub(done))
    with pytest.raises(ConfigError, match=r"fleet.jobs.rows = 4, not 5"):
        predict_fleet(table_of(tmp_path, 5), out, Stub(done))
    with pytest.raises(ConfigError, match="confidence"):
        predict_fleet(table_of(tmp_path, 4), out, Stub(done), confidence=True)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").touch()
    with pytest.raises(ConfigError, match="not empty"):
        predict_fleet(table_of(tmp_path, 4), tmp_path / "other", Stub(done))


def test_what_cannot_be_used_is_told_before_any_work(tmp_path):
    table = table_of(tmp_path, 4)
    with pytest.raises(ConfigError, match="--chunk"):
        predict_fleet(table, tmp_path / "out", Stub(done), chunk=0)
    (tmp_path / "out").mkdir()
    with locked_file(tmp_path / "out" / ".fleet.lock", ""), pytest.raises(LockedError):
        predict_fleet(table, tmp_path / "out", Stub(done))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return finished_run(tmp_path_factory.mktemp("fleet"))


@pytest.fixture
def photos(run, tmp_path):
    """A table of which the third to the sixth cannot be done, and the map that the others get."""
    scene = run.path.parent / "scene"
    photo, camera = str(scene / "test" / "test_00.png"), str(scene / "transforms_test.json")
    table = {
        "run": [str(run.path)] * 3 + [str(scene), str(run.path), "", str(run.path)],
        "photo": [photo, photo, "gone.png", photo, photo, photo, photo],
        "camera": [camera] * 7,
        "method": ["constant", None, None, None, "guess", None, None],
        "id": list("abcdefg"),
    }
    pq.write_table(pa.table(table), tmp_path / "photos.parquet")
    request = PredictRequest(photo=Path(photo), camera=Path(camera))
    list(predict_photos(Session(run.path, "cpu"), [request], ChosenFiles(tmp_path / "alone.exr")))
    return tmp_path / "photos.parquet", (tmp_path / "alone.exr").read_bytes()


REASONS = [
    None,
    None,
    "gone.png does not exist",
    "is not a run folder",
    "'method' must be one of",
    "has no run",
    None,
]


def check(rows, read, alone):
    assert [row["id"] for row in rows] == list("abcdefg")
    for row, reason in zip(rows, REASONS, strict=True):
        assert row["state"] == ("failed" if reason else "done")
        assert (reason or "") in (row["reason"] or "")
    assert [row["method"] for row in rows if row["state"] == "done"] == ["constant", "solve", "solve"]
    assert rows[1]["verdict"] == "good"
    assert 0 < rows[1]["confidence"] < 1
    assert read(rows[1]["map"]) == alone
    assert read(rows[6]["map"]) == alone
    assert b'"sources"' in read(rows[1]["map"].replace(".exr", ".light.json"))
    assert rows[1]["map"] == "/".join(map_place(1)) + ".exr"


@pytest.mark.slow
def test_photos_get_the_maps_that_they_get_alone(photos, tmp_path):
    table, alone = photos
    found = predict_fleet(table, tmp_path / "out", Stub(), chunk=4, confidence=True)
    assert (found.done, found.failed) == (3, 4)
    check(index_of(tmp_path / "out"), lambda name: (tmp_path / "out" / name).read_bytes(), alone)
    assert (tmp_path / "out" / "maps" / "000000" / "000000006.confidence.exr").is_file()
    assert not list((tmp_path / "out").rglob("*partial*"))


@pytest.mark.slow
def test_object_stores_serve_as_folders_do(run, photos, tmp_path):
    """Run, photo, camera, jobs and results by URL."""
    table, alone = photos
    store = Place.of("memory://fleet")
    for path in run.path.rglob("*"):
        if path.is_file():
            store.child("run", *path.relative_to(run.path).parts).write(path.read_bytes())
    scene = run.path.parent / "scene"
    store.child("photos", "test_00.png").write((scene / "test" / "test_00.png").read_bytes())
    store.child("photos", "transforms_test.json").write((scene / "transforms_test.json").read_bytes())
    table = pq.read_table(table).to_pydict()
    there = {
        str(run.path): "run",
        str(scene / "test" / "test_00.png"): "photos/test_00.png",
        str(scene / "transforms_test.json"): "photos/transforms_test.json",
    }
    moved = {name: [there.get(value, value) for value in values] for name, values in table.items()}
    pq.write_table(pa.table(moved), tmp_path / "moved.parquet")
    store.child("photos.parquet").write((tmp_path / "moved.parquet").read_bytes())
    predict_fleet(str(store.child("photos.parquet")), str(store.child("out")), Stub(), chunk=4)
    parts = [store.child("out", "index", name) for name in store.child("out", "index").names()]
    shutil.rmtree(tmp_path / "index", ignore_errors=True)
    for part in parts:
        Place.of(tmp_path).child("index", part.name).write(part.read())
    check(index_of(tmp_path), lambda name: store.child("out", *name.split("/")).read(), alone)

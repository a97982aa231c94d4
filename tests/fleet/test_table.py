"""Tables of photos: their columns, their rows, and how neighbours become tasks."""

from dataclasses import fields

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lightprobe.core.errors import InputError
from lightprobe.fleet.storage import Place
from lightprobe.fleet.table import PhotoTable, TableRow
from lightprobe.jobs import LightOptions


def written(path, **columns):
    pq.write_table(pa.table(columns), path)
    return PhotoTable(Place.of(path))


def every(file):
    return [row for rows in file.chunks(100, lambda row: True) for row in rows]


def test_rows_are_read_with_the_options_that_they_have(tmp_path):
    file = written(
        tmp_path / "photos.parquet",
        run=["a", "b"],
        photo=["1.png", None],
        camera=["c.json", None],
        sources=[None, "false"],
    )
    assert file.rows == 2
    assert every(file) == [
        TableRow(0, "a", "1.png", "c.json"),
        TableRow(1, "b", "", options={"sources": "false"}),
    ]


@pytest.mark.parametrize("option", [field.name for field in fields(LightOptions)])
def test_every_option_of_a_prediction_is_a_column(tmp_path, option):
    (row,) = every(written(tmp_path / "photos.parquet", run=["a"], photo=["1.png"], **{option: ["x"]}))
    assert row.options == {option: "x"}


def test_only_wanted_rows_are_read_out(tmp_path):
    file = written(tmp_path / "photos.parquet", run=["a"] * 40_000, photo=["p"] * 40_000)
    found = [one.row for rows in file.chunks(9, lambda row: row % 20_000 == 3) for one in rows]
    assert found == [3, 20_003]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"run": ["a"]}, "no column 'photo'"),
        ({"run": ["a"], "photo": [1]}, "must be text"),
        ({"run": ["a"], "photo": ["p"], "weight": ["1"]}, "column 'weight'"),
    ],
)
def test_other_columns_are_refused(tmp_path, columns, words):
    with pytest.raises(InputError, match=words):
        written(tmp_path / "photos.parquet", **columns)


def test_columns_of_categories_are_text_too(tmp_path):
    file = written(
        tmp_path / "photos.parquet", run=pa.array(["a", "a"]).dictionary_encode(), photo=["1", "2"]
    )
    assert [row.run for row in every(file)] == ["a", "a"]


def test_what_is_no_parquet_file_is_told(tmp_path):
    path = tmp_path / "photos.parquet"
    path.write_bytes(b"PAR1 not really PAR1")
    with pytest.raises(InputError, match="cannot be read as Parquet"):
        PhotoTable(Place.of(path))
    with pytest.raises(InputError, match="does not exist"):
        PhotoTable(Place.of(tmp_path / "gone.parquet"))


def test_a_damaged_page_is_told_with_its_row(tmp_path):
    path = tmp_path / "photos.parquet"
    rows = [str(i) for i in range(20_000)]
    pq.write_table(pa.table({"run": rows, "photo": rows}), path, compression="zstd", use_dictionary=False)
    data = bytearray(path.read_bytes())
    data[1000:3000] = bytes(2000)
    path.write_bytes(data)
    with pytest.raises(InputError, match="damaged after row"):
        every(PhotoTable(Place.of(path)))


def test_another_file_has_another_identity(tmp_path):
    first = written(tmp_path / "a.parquet", run=["a"], photo=["1.png"]).identity()
    assert first == written(tmp_path / "b.parquet", run=["a"], photo=["1.png"]).identity()
    assert first != written(tmp_path / "c.parquet", run=["a"], photo=["2.png"]).identity()


def test_a_file_in_an_object_store_is_read_as_well(tmp_path):
    here = tmp_path / "photos.parquet"
    file = written(here, run=["a"], photo=["1.png"])
    there = Place.of("memory://bucket/photos.parquet")
    there.write(here.read_bytes())
    assert every(PhotoTable(there)) == every(file)
    assert PhotoTable(there).identity() == file.identity()


def test_tasks_are_of_one_run_and_not_too_long(tmp_path):
    file = written(tmp_path / "photos.parquet", run=list("ababababab"), photo=["p"] * 10)
    found = [[one.row for one in rows] for rows in file.chunks(3, lambda row: True)]
    assert found == [[0, 2, 4], [6, 8], [1, 3, 5], [7, 9]]

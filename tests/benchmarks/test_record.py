import json

import pytest

from benchmarks.record import Kind, Record, read_records
from lightprobe.core.errors import InputError
from tests.benchmarks.records import metrics, record


def test_a_record_comes_back_with_means_and_intervals_by_light(tmp_path):
    scored = metrics()
    scored["photos"]["c"] = {"light": "sea", "methods": {"net": {"psnr": 36.0, "not_in_tables": 1.0}}}
    before = record(
        "cup",
        scored=scored,
        seed=3,
        command="lightprobe eval RUNS/cup",
        training={"decompose": 601.0},
        object_verdict={"disagreement": 0.05, "trust": "good"},
    )
    before.write(tmp_path)
    after = Record.read(tmp_path / "cup.json")
    assert {**vars(after), "metrics": None} == {**vars(before), "metrics": None}
    assert after.metrics["methods"]["net"]["psnr"] == pytest.approx(32.0)  # of 30, 30 and 36
    assert after.metrics["interval"]["net"]["psnr"] == pytest.approx(
        12.7062 * 2 * 4 / 3, rel=1e-4
    )  # two lights
    assert "psnr_masked" not in after.metrics["interval"]["slow"]  # one photo
    assert after.metrics["photos"]["c"] == {"light": "sea", "methods": {"net": {"psnr": 36.0}}}
    assert after.metrics["mean"]["chamfer"] == 0.0123
    assert after.metrics["confidence"] == {
        method: {**checked, "bins": [pytest.approx(part) for part in checked["bins"]]}
        for method, checked in scored["confidence"].items()
    }


def test_the_names_of_records_tell_them_apart():
    every = [
        record("cup"),
        record("cup", Kind.ORACLE),
        record("cup", Kind.SEED, seed=2),
        record("cup", Kind.PAPER),
        record("cup", Kind.LESSONS, label="photos alone"),
        record("cup", Kind.LOSS, label="L2, both weights", seed=1),
    ]
    assert [each.name for each in every] == [
        "cup",
        "cup.oracle",
        "cup.seed2",
        "cup.paper",
        "cup.lessons.photos-alone",
        "cup.loss.L2-both-weights.seed1",
    ]


def test_a_record_is_small(tmp_path):
    scored = metrics()
    scored["photos"] = {f"photo_{i:03}": scored["photos"]["a"] for i in range(16)}
    record("cup", scored=scored).write(tmp_path)
    assert (tmp_path / "cup.json").stat().st_size < 5000
    assert len(json.dumps(scored, indent=2)) > 3 * 5000


WITHOUT_PHOTOS = {
    "format": 1,
    "scene": "a",
    "kind": "run",
    "default_method": "net",
    "truth": {},
    "confidence": {},
    "photos": [],
    "lights": [],
    "scores": {"net": {"psnr": []}},
}


@pytest.mark.parametrize(
    "text",
    ["[]", "{}", '{"format": 2}', '{"format": 1, "scene": "a", "kind": "other"}', json.dumps(WITHOUT_PHOTOS)],
)
def test_a_file_that_is_no_record_is_named(tmp_path, text):
    (tmp_path / "cup.json").write_text(text)
    with pytest.raises(InputError, match=r"cup\.json is no record"):
        read_records(tmp_path)


def test_no_folder_holds_no_records(tmp_path):
    assert read_records(tmp_path / "gone") == []

"""inspect, as typed."""

import pytest

from tests.cli.commands import fails, succeed
from tests.scene.demo_shots import demo_shots, inverted, write_shots
from tests.scene.plain_world import take
from tests.scene.worlds import views, write_nerd


def test_plain_photos_are_reported_and_nothing_is_written(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    succeed("inspect", take(tmp_path / "photos", 10))
    out = capsys.readouterr().out
    assert "photos (no cameras yet)" in out
    assert "no problems" in out
    assert "next     about 15 more photos" in out
    assert [path.name for path in tmp_path.iterdir()] == ["photos"]


def test_too_few_plain_photos_fail(tmp_path, capsys):
    code = fails(
        ["inspect", take(tmp_path / "photos", 3)], capsys, ["photos cannot be used as it is", "1 problem(s)"]
    )
    assert code == 2


def test_a_sheet_needs_cameras(tmp_path, capsys):
    photos = take(tmp_path / "photos", 10)
    assert fails(["inspect", photos, "-o", tmp_path / "s.png"], capsys, ["no cameras", "--output"]) == 3
    assert not (tmp_path / "s.png").exists()


@pytest.mark.slow
def test_a_scene_with_cameras_gets_its_sheet(tmp_path, capsys):
    succeed("inspect", write_nerd(tmp_path / "scene", views(18)), "-o", tmp_path / "s.png")
    assert (tmp_path / "s.png").exists()
    assert "no problems" in capsys.readouterr().out
    photo = min((tmp_path / "scene").rglob("*.png"))
    kept = photo.read_bytes()
    fails(["inspect", tmp_path / "scene", "-o", photo], capsys, [photo.name, "would be replaced"])
    assert photo.read_bytes() == kept


def test_a_run_is_no_folder_of_photos(tmp_path, capsys):
    run = take(tmp_path / "run", 10)
    (run / "config.json").write_text("{}")
    assert fails(["inspect", run], capsys, ["is a run and no folder of photos"]) == 2


@pytest.mark.slow
@pytest.mark.parametrize("command", ["train", "fit"])
def test_a_training_refuses_what_inspect_calls_a_problem_before_any_work(
    tmp_path, capsys, monkeypatch, command
):
    monkeypatch.chdir(tmp_path)
    shots, common = demo_shots()
    scene = write_shots(tmp_path / "scene", [inverted(shot) for shot in shots], common)
    fails(["inspect", scene], capsys, ["scene cannot be used as it is", "1 problem(s)"])
    words = ["cannot be trained on. The masks of all 20 photos look inverted"]
    assert fails([command, scene, "-o", tmp_path / "run"], capsys, words) == 2
    assert not (tmp_path / "run").exists()

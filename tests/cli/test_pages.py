"""report, as a person runs it: one run, two, many."""

import json
import re

import pytest

from lightprobe.cli import pages
from lightprobe.core.files import write_json
from lightprobe.runs.pages import write_gallery
from tests.cli.commands import fails, succeed
from tests.report.pages import evaluated_run

SCORES = {"a": 20.0, "b": 30.0}


def test_open_shows_the_report_in_the_browser_and_says_where_it_is(tmp_path, capsys, monkeypatch):
    run = evaluated_run(tmp_path / "a run", SCORES)
    fails(["report", run.path], capsys, ["has no report", f"lightprobe eval '{run.path}'"])
    run.report_file.write_text("<html>")
    shown = []
    monkeypatch.setattr(pages.webbrowser, "open", lambda address: shown.append(address) or True)
    monkeypatch.setenv("DISPLAY", ":0")
    succeed("report", run.path)
    assert capsys.readouterr().out == f"Report: {run.report_file}\n"
    assert shown == [run.report_file.as_uri()]


def test_open_starts_no_browser_where_there_is_no_screen(tmp_path, capsys, monkeypatch):
    run = evaluated_run(tmp_path / "run", SCORES)
    run.report_file.write_text("<html>")
    monkeypatch.setattr(pages.sys, "platform", "linux")
    monkeypatch.setattr(pages.webbrowser, "open", lambda address: 1 / 0)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    succeed("report", run.path, "--json")
    assert json.loads(capsys.readouterr().out) == {"report": str(run.report_file), "opened": False}


def test_compare_writes_a_page_and_prints_the_differences(tmp_path, capsys):
    old = evaluated_run(tmp_path / "old", SCORES)
    new = evaluated_run(tmp_path / "new", {"a": 21.0, "b": 32.0})
    succeed("report", old.path, new.path, "-o", tmp_path / "page.html")
    printed = capsys.readouterr().out
    assert "+1.50 ±" in printed
    assert "old against new" in (tmp_path / "page.html").read_text()
    succeed("report", old.path, new.path, "-o", tmp_path / "page.html", "--json")
    answer = json.loads(capsys.readouterr().out)
    assert answer["page"] == str(tmp_path / "page.html")
    assert answer["methods"][0]["scores"]["psnr_masked"]["difference"] == 1.5
    fails(["report", old.path, new.path, "-o", tmp_path / "page.txt"], capsys, ["name it .html"])
    fails(["report", old.path, new.path, "-o", new.report_file], capsys, ["index.html would be replaced"])


def test_a_difference_over_one_photo_has_no_interval(tmp_path, capsys):
    runs = [
        evaluated_run(tmp_path / name, {"a": value}).path for name, value in (("old", 20.0), ("new", 21.0))
    ]
    succeed("report", *runs, "-o", tmp_path / "page.html")
    printed = capsys.readouterr().out
    assert "+1.00" in printed
    assert "nan" not in printed


def test_a_gallery_needs_nothing_outside_of_its_folder(tmp_path, capsys):
    first = evaluated_run(tmp_path / "x" / "pot", SCORES)
    second = evaluated_run(tmp_path / "y" / "pot", SCORES)
    for _ in range(2):  # the same command writes it anew
        succeed("report", first.path, second.path, "--gallery", tmp_path / "gallery")
    files = {
        path.relative_to(tmp_path / "gallery").as_posix() for path in (tmp_path / "gallery").rglob("*.html")
    }
    assert files == {"index.html", "pot/index.html", "pot-2/index.html"}
    page = (tmp_path / "gallery" / "index.html").read_text()
    assert re.findall(r'href="([^"#]+)"', page) == ["pot/index.html", "pot-2/index.html"]
    assert not re.findall(r'href="([^"#]+)"', (tmp_path / "gallery" / "pot" / "index.html").read_text())
    assert "Runs: 2, in" in capsys.readouterr().out


def test_a_gallery_of_nothing_or_onto_a_file_is_refused(tmp_path, capsys):
    fails(["report", "--gallery", tmp_path / "gallery"], capsys, ["No run is named"])
    run = evaluated_run(tmp_path / "pot", SCORES)
    (tmp_path / "file").write_text("mine")
    fails(["report", run.path, "--gallery", tmp_path / "file"], capsys, ["is a file"])
    fails(["report", tmp_path, "--gallery", tmp_path / "gallery"], capsys, ["is not a run folder"])
    fails(["report", run.path, "--gallery", run.path / "pages"], capsys, ["belongs to the run"])
    fails(["report", run.path, "--gallery", tmp_path], capsys, ["holds other files than a gallery"])
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "index.html").write_text("<html>mine")
    fails(["report", run.path, "--gallery", tmp_path / "site"], capsys, ["holds other files than a gallery"])
    assert (tmp_path / "site" / "index.html").read_text() == "<html>mine"
    assert not (tmp_path / "gallery").exists()
    fails(["report", run.path, run.path, run.path], capsys, ["Name one run"])


def test_a_gallery_that_was_interrupted_goes_on(tmp_path, monkeypatch):
    run = evaluated_run(tmp_path / "pot", SCORES)
    with monkeypatch.context() as cut:
        cut.setattr("lightprobe.runs.pages.write_report", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            write_gallery([run.path], tmp_path / "gallery")
    write_gallery([run.path], tmp_path / "gallery")
    assert (tmp_path / "gallery" / "pot" / "index.html").is_file()


def test_photos_of_one_name_that_are_not_the_same_are_told(tmp_path, capsys):
    first, second = (evaluated_run(tmp_path / name, SCORES) for name in ("first", "second"))
    for run, digests in ((first, ("1", "2")), (second, ("1", "3"))):
        photos = {
            name: {"image": f"{name}.png", "image_checksum": d}
            for name, d in zip(SCORES, digests, strict=True)
        }
        write_json(run.scene_file, {"root": "/scene", "photos": {"test": photos}})
    succeed("report", first.path, second.path, "-o", tmp_path / "page.html")
    assert (
        "1 of 2 test photos that both runs have by name are different ones, such as b"
        in capsys.readouterr().err
    )

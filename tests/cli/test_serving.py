"""`lightprobe serve` refuses what it could not do safely, in a sentence."""

import json

import pytest

from lightprobe.cli.main import main
from lightprobe.service import server
from tests.cli.commands import fails
from tests.service.serving import runs_folder


@pytest.fixture
def runs(tmp_path, monkeypatch):
    monkeypatch.delenv("LIGHTPROBE_TOKEN", raising=False)
    return runs_folder(tmp_path / "runs")


def test_what_cannot_be_served_is_one_sentence(runs, tmp_path, capsys):
    assert fails(["serve", tmp_path / "missing"], capsys, ["is no folder of runs"]) == 2
    assert (
        fails(["serve", runs, "--host", "0.0.0.0"], capsys, ["can be reached by others", "--token-file"]) == 3
    )
    assert fails(["serve", runs, "--workers", "0"], capsys, ["--workers 0"]) == 3
    assert fails(["serve", runs, "--queue", "0"], capsys, ["--queue"]) == 3
    assert fails(["serve", runs, "--devices", "cuda:0", "cuda:0"], capsys, ["twice"]) == 3
    assert fails(["serve", runs, "--token-file", tmp_path / "none"], capsys, ["does not exist"]) == 2
    assert fails(["serve", runs, "--port", "99999"], capsys, ["is no port"]) == 3


def test_the_token_comes_from_its_file_or_the_environment(runs, tmp_path, monkeypatch, capsys):
    given = []

    def serve_folder(folder, **options):
        given.append(options["token"])
        options["tell"]("Service: http://127.0.0.1:1/   (1 workers)")
        return server.Served(requests=3, predictions=2)

    monkeypatch.setattr("lightprobe.cli.serving.serve_folder", serve_folder)
    (tmp_path / "token").write_text("from-a-file-from-a-file\n")
    monkeypatch.setenv("LIGHTPROBE_TOKEN", "from-the-environment")
    assert main(["serve", str(runs), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "service": "http://127.0.0.1:1/",
        "predictions": 2,
        "requests": 3,
    }
    assert main(["serve", str(runs), "--token-file", str(tmp_path / "token")]) == 0
    monkeypatch.delenv("LIGHTPROBE_TOKEN")
    assert main(["serve", str(runs)]) == 0
    assert given == ["from-the-environment", "from-a-file-from-a-file", None]

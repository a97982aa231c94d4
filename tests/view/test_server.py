"""The command from start to end, short of a browser."""

import tempfile
import threading
import time
import urllib.request

import pytest
import uvicorn

from lightprobe.core import extras
from lightprobe.view import serve
from lightprobe.view import server as module
from tests.cli.commands import fails


def test_the_page_is_announced_served_and_cleared_away(run, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    servers, said = [], []
    start = uvicorn.Server.__init__
    monkeypatch.setattr(uvicorn.Server, "__init__", lambda self, *a: servers.append(self) or start(self, *a))
    work = threading.Thread(
        target=lambda: serve([run.path], port=0, browser=False, device="cpu", tell=said.append), daemon=True
    )
    work.start()
    while not (servers and servers[0].started):
        time.sleep(0.02)
    url = said[0].split()[1]
    assert b"lightprobe" in urllib.request.urlopen(url).read()
    assert len(list(tmp_path.iterdir())) == 1
    servers[0].should_exit = True
    work.join(timeout=10)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_shown_is_one_sentence(tmp_path, capsys):
    assert fails(["view", tmp_path, "--no-open"], capsys, ["neither a run", "lightprobe train"]) == 2
    assert fails(["view", "--no-open"], capsys, ["No run is named"]) == 3


def test_without_its_libraries_a_sentence_names_the_extra(run, capsys, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(extras.importlib, "import_module", missing)
    with pytest.raises(Exception, match=r"needs fastapi, .* 'lightprobe\[view\]'"):
        module.serve([run.path])

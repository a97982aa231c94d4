"""The command from start to end, short of a browser: where the page listens, and how a phone finds it."""

import socket
import tempfile
import threading
import time
import urllib.request

import numpy as np
import pytest
import uvicorn

from lightprobe.core import extras
from lightprobe.core.errors import ResourceError
from lightprobe.view import serve
from lightprobe.view import server as module
from lightprobe.view.server import Address, open_address, qr_code
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


def test_the_page_is_reachable_from_this_machine_alone():
    address = open_address(0, lan=False)
    with address.listening:
        assert address.listening.getsockname()[0] == "127.0.0.1"
        assert address.hosts == {f"127.0.0.1:{address.port}", f"localhost:{address.port}"}
        assert (address.token, address.network_url) == (None, None)
        with pytest.raises(ResourceError, match="choose another with --port"):
            open_address(address.port, lan=False)


def test_browsers_leave_out_the_usual_port():
    hosts = Address(socket.socket(), 80, None, "192.168.1.7").hosts
    assert {"localhost", "localhost:80", "192.168.1.7"} <= hosts
    assert "localhost" not in Address(socket.socket(), 8080, None, None).hosts


class Network(socket.socket):
    """A machine at an address of a network at home, or of none."""

    address: str | None = "192.168.1.7"

    def connect(self, address):
        if self.address is None:
            raise OSError("Network is unreachable")

    def getsockname(self):
        name = super().getsockname()
        return (self.address, name[1]) if self.type is socket.SOCK_DGRAM else name


def test_in_the_network_there_is_a_token(monkeypatch):
    monkeypatch.setattr(socket, "socket", Network)
    tokens = set()
    for _ in range(2):
        address = open_address(0, lan=True)
        address.listening.close()
        assert f"192.168.1.7:{address.port}" in address.hosts
        assert address.network_url == f"http://192.168.1.7:{address.port}/?token={address.token}"
        tokens.add(address.token)
    assert len(tokens) == 2
    assert all(len(token) >= 20 for token in tokens)


def test_without_a_network_a_sentence_says_so(monkeypatch):
    monkeypatch.setattr(socket, "socket", Network)
    monkeypatch.setattr(Network, "address", None)
    with pytest.raises(ResourceError, match="--lan needs a network"):
        open_address(0, lan=True)


def test_the_qr_code_in_the_terminal_is_read_as_the_address():
    cv2 = pytest.importorskip("cv2")
    url = "http://192.168.1.7:8421/?token=abcdefghijklmnopqrstuv"
    light = {"█": (1, 1), "▀": (1, 0), "▄": (0, 1), " ": (0, 0)}  # upper and lower half
    rows = [list(zip(*(light[block] for block in line), strict=True)) for line in qr_code(url).split("\n")]
    modules = np.array([half for pair in rows for half in pair], np.uint8)
    picture = 255 * np.pad(modules, 4, constant_values=1).repeat(8, 0).repeat(8, 1)
    assert cv2.QRCodeDetector().detectAndDecode(picture)[0] == url

"""Where the page listens, and how a phone finds it."""

import socket

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError, ResourceError
from lightprobe.view.network import Address, open_address, qr_code


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


@pytest.mark.parametrize("port", [-1, 65536])
def test_a_number_that_is_no_port_is_refused(port):
    with pytest.raises(ConfigError, match="is no port"):
        open_address(port, lan=False)


def test_in_the_network_there_is_a_token(monkeypatch):
    monkeypatch.setattr("lightprobe.view.network._own_address", lambda: "192.168.1.7")
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
    class Nowhere(socket.socket):
        def connect(self, address):
            raise OSError("Network is unreachable")

    monkeypatch.setattr("lightprobe.view.network.socket.socket", Nowhere)
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

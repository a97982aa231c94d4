"""A socket to listen on, a server on it, and signals that end both."""

import signal
import threading
import time

import httpx2
import pytest
import uvicorn

from lightprobe.core.errors import ConfigError, ResourceError
from lightprobe.core.partial import partial_folder
from lightprobe.web.asgi import reply
from lightprobe.web.listening import listening_socket, run_app, until_interrupted


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_server_and_its_folder_goes(tmp_path, number):
    """Uvicorn raises the signal that ended it once more: by then it must not end the process."""
    with until_interrupted(), partial_folder(tmp_path):
        assert len(list(tmp_path.iterdir())) == 1
        signal.raise_signal(number)
    assert list(tmp_path.iterdir()) == []


def test_an_address_that_cannot_be_used_is_refused():
    with (
        listening_socket("127.0.0.1", 0) as taken,
        pytest.raises(ResourceError, match="choose another with --port"),
    ):
        listening_socket("127.0.0.1", taken.getsockname()[1])
    for host in ("192.0.2.1", "a" * 70 + ".example"):
        with pytest.raises(ResourceError, match="cannot be used"):
            listening_socket(host, 0)
    for port in (-1, 65536):
        with pytest.raises(ConfigError, match="is no port"):
            listening_socket("127.0.0.1", port)


def test_a_body_that_was_refused_does_not_hide_the_answer(monkeypatch):
    """Uvicorn takes what is still sent after an early answer, so that the client gets to read the answer."""
    servers = []
    start = uvicorn.Server.__init__
    monkeypatch.setattr(uvicorn.Server, "__init__", lambda self, *a: servers.append(self) or start(self, *a))

    async def refuse(scope, receive, send):
        await reply(send, 413, "Too large.")

    with listening_socket("127.0.0.1", 0) as listening:
        work = threading.Thread(
            target=run_app, args=(refuse, listening), kwargs={"grace": 1, "log_config": None}
        )
        work.start()
        while not (servers and servers[0].started):
            time.sleep(0.02)
        answer = httpx2.post(f"http://127.0.0.1:{listening.getsockname()[1]}/", content=bytes(2**22))
        servers[0].should_exit = True
        work.join(10)
    assert answer.json() == {"sentence": "Too large."}

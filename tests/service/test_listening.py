"""A socket to listen on, and signals that end a server."""

import signal

import pytest

from lightprobe.core.errors import ConfigError, ResourceError
from lightprobe.core.partial import partial_folder
from lightprobe.service.listening import listening_socket, until_interrupted


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
    with pytest.raises(ConfigError, match="is no port"):
        listening_socket("127.0.0.1", 70000)

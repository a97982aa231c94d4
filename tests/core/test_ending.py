"""One sentence for several processes that end."""

import os
import signal
import threading
from datetime import timedelta

import pytest
import torch.distributed as dist

from lightprobe.core import ending


class EndedError(Exception):
    """Stands for the end of the process."""


@pytest.fixture
def torchrun(monkeypatch):
    """Stand for torchrun: its variables, its store, and an end that can be caught."""
    store = dist.TCPStore(
        "127.0.0.1", 0, is_master=True, wait_for_workers=False, timeout=timedelta(seconds=5)
    )
    given = {"WORLD_SIZE": "2", "RANK": "0", "TORCHELASTIC_RUN_ID": "test", "TORCHELASTIC_RESTART_COUNT": "0"}
    given |= {
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": str(store.port),
        "TORCHELASTIC_USE_AGENT_STORE": "True",
    }
    for name, value in given.items():
        monkeypatch.setenv(name, value)

    def stop(code):
        raise EndedError(code)

    monkeypatch.setattr(os, "_exit", stop)
    return store


def test_one_process_says_why_it_ends(capsys):
    assert ending.started_together() == 1
    assert ending.end("lightprobe: so.", 3) == 3
    assert capsys.readouterr().err == "lightprobe: so.\n"


def test_only_the_first_that_ends_says_why(torchrun, monkeypatch, capsys):
    assert ending.started_together() == 2
    for sentence in ("lightprobe: the cause.", "lightprobe: what follows."):
        with pytest.raises(EndedError, match="4"):
            ending.end(sentence, 4)
    assert capsys.readouterr().err == "lightprobe: the cause.\n"
    monkeypatch.setenv("TORCHELASTIC_RESTART_COUNT", "1")  # torchrun has started all anew
    with pytest.raises(EndedError):
        ending.end("lightprobe: another cause.", 4)
    assert capsys.readouterr().err == "lightprobe: another cause.\n"


def test_where_torchrun_cannot_be_asked_everyone_speaks(torchrun, monkeypatch, capsys):
    monkeypatch.setenv("TORCHELASTIC_USE_AGENT_STORE", "False")
    for _ in range(2):
        with pytest.raises(EndedError):
            ending.end("lightprobe: so.", 4)
    assert capsys.readouterr().err == "lightprobe: so.\n" * 2


def test_a_process_that_is_told_to_end_says_so_whatever_it_waits_for(monkeypatch, capsys):
    ended, codes, before = threading.Event(), [], signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(os, "_exit", lambda code: (codes.append(code), ended.set()))
    with ending.ending_with_torchrun():
        os.kill(os.getpid(), signal.SIGTERM)
        assert ended.wait(10)
    assert codes == [143]
    assert ending.LOST in capsys.readouterr().err
    assert signal.getsignal(signal.SIGTERM) is before


def test_one_that_failed_is_told_to_end_before_it_has_said_why(monkeypatch, capsys):
    ended, before = threading.Event(), signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(os, "_exit", lambda code: ended.set())
    with pytest.raises(EndedError), ending.ending_with_torchrun():
        raise EndedError
    try:
        assert callable(signal.getsignal(signal.SIGTERM))  # else the next line ends the tests
        os.kill(os.getpid(), signal.SIGTERM)
        assert ended.wait(10)
    finally:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGTERM, before)
    assert ending.LOST in capsys.readouterr().err

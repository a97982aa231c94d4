"""How several processes that `torchrun` started end: one of them says why, in one sentence, and the others
are silent.

When one fails, the others fail after it, for want of it. Whoever fails first asks torchrun's store, which
outlives them all, for the word, and so the sentence is about the cause.
"""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from datetime import timedelta

import torch.distributed as dist

LOST = (
    "Another process of this training has ended, or torchrun was told to end; the same command goes on from the last "
    "checkpoint."
)
_TERMINATED = 128 + signal.SIGTERM  # what shells report for a program ended by SIGTERM
_STORE_WAIT = timedelta(seconds=5)  # for torchrun, which is on this machine or one that has just answered

_speaking = threading.Lock()


def started_together() -> int:
    """Return how many processes `torchrun` started together with this one, itself included; 1 without it."""
    return int(os.environ.get("WORLD_SIZE", "1")) if "TORCHELASTIC_RUN_ID" in os.environ else 1


def end(sentence: str, code: int) -> int:
    """Print a sentence on standard error and return the exit code of the program.

    One of several processes prints only where none has spoken before, and ends at once: what it still
    exchanges with processes that are gone would keep it waiting.
    """
    if started_together() == 1:
        print(sentence, file=sys.stderr)
        return code
    _speak(sentence)
    sys.stdout.flush()
    os._exit(code)


@contextlib.contextmanager
def ending_with_torchrun() -> Iterator[None]:
    """End with a sentence, at once, when torchrun ends this process, whatever it is waiting for.

    Python's own handlers run between two of its instructions. A process that waits for a GPU, and that for
    another process which is gone, gets to none; so a thread of its own reads the signals here. It does so
    also after an error in the block, after which nothing is put back: torchrun may end this process, for want
    of the other one, before it has said why it ends.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    handler = signal.signal(signal.SIGTERM, lambda *_: None)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    watcher = threading.Thread(target=_watch, args=(reading,), daemon=True)
    watcher.start()
    yield
    signal.set_wakeup_fd(before)
    signal.signal(signal.SIGTERM, handler)
    os.close(writing)
    watcher.join()


def _watch(reading: int) -> None:
    with open(reading, "rb", buffering=0) as signals:
        while number := signals.read(1):
            if number[0] == signal.SIGTERM:
                _speak(f"lightprobe: {LOST}")
                os._exit(_TERMINATED)


def _speak(sentence: str) -> None:
    with _speaking:  # the process must not be ended between asking for the word and having spoken
        if _may_speak():
            print(sentence, file=sys.stderr, flush=True)


def _may_speak() -> bool:
    """Return whether none of the processes has asked before, or whether torchrun cannot tell."""
    given = os.environ
    if given.get("TORCHELASTIC_USE_AGENT_STORE") != "True":
        return True
    try:
        store = dist.TCPStore(given["MASTER_ADDR"], int(given["MASTER_PORT"]), timeout=_STORE_WAIT)
        return store.add(f"lightprobe/ended/{given.get('TORCHELASTIC_RESTART_COUNT')}", 1) == 1
    except (RuntimeError, KeyError, ValueError):
        return True

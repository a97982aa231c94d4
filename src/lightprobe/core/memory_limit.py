"""The most memory that a command may take, `--max-memory`: what is left of it, and the end where it is
passed.

Readers of photos ask `memory_left` before they decode, and reduce or refuse. What they cannot foresee, such
as what a training holds by its settings, is watched: a process beyond its limit ends with a sentence, and as
after any kill nothing is half written. A limit of the system's (RLIMIT_AS) would not do: it counts what
PyTorch and Numba reserve and never touch.
"""

import contextlib
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator

from lightprobe.core.errors import ConfigError, ResourceError
from lightprobe.core.memory import peak_memory, resident_bytes

_UNITS = {"MB": 10**6, "GB": 10**9, "MiB": 2**20, "GiB": 2**30}
_PAUSE = 0.02  # seconds between two looks at what the process holds
_BESIDE = 128 * 2**20  # bytes: the strips of rows that are worked on beside a photo

_limits: list[int] = []  # the one in force is the last


def parse_size(text: str) -> int:
    """Return the bytes of a size such as 4GB or 512MB; raise `ConfigError` when it is none."""
    found = re.fullmatch(r"(\d{1,9}(?:\.\d{1,6})?) ?(MB|GB|MiB|GiB)", text)
    if found is None or not float(found[1]):
        raise ConfigError(f"--max-memory needs a size such as 4GB or 512MB (also GiB, MiB), not '{text}'.")
    return int(float(found[1]) * _UNITS[found[2]])


def in_gigabytes(size: float) -> str:
    """Return a number of bytes as people read it."""
    return f"{size / 1e9:.2f} GB"


def current_limit() -> int | None:
    """Return the limit in bytes, None where there is none."""
    return _limits[-1] if _limits else None


def memory_left() -> int | None:
    """Return the bytes that the limit leaves for a photo, beside what the process holds; None without a
    limit.
    """
    return None if not _limits else _limits[-1] - _held() - _BESIDE


@contextlib.contextmanager
def memory_limit(limit: int | None, on_end: Callable[[str], None] | None = None) -> Iterator[None]:
    """Hold this process to `limit` bytes meanwhile, None for no limit; it ends where it takes more.

    on_end: called from another thread with the sentence that is said then, before the process ends.
    Raises `ConfigError` where the system does not tell what a process holds, `ResourceError` where it has
    passed it.
    """
    if limit is None:
        yield
        return
    if peak_memory() is None:
        raise ConfigError(
            "--max-memory cannot be held here: this system does not tell how much memory a process has."
        )
    if _held() > limit:
        raise ResourceError(
            f"--max-memory {in_gigabytes(limit)} is less than the {in_gigabytes(_held())} that the program takes "
            "before it begins; give it more."
        )
    done = threading.Event()
    watch = threading.Thread(target=_watch, args=(limit, done, on_end), daemon=True)
    _limits.append(limit)
    watch.start()
    try:
        yield
    finally:
        done.set()
        watch.join()
        _limits.pop()


def _held() -> int:
    """Return the resident bytes of this process; where only their peak is told, that."""
    now = resident_bytes(os.getpid())
    return now if now is not None else int((peak_memory() or 0) * 2**30)


def _watch(limit: int, done: threading.Event, on_end: Callable[[str], None] | None) -> None:
    """End the process when it holds more than `limit` bytes, until `done`."""
    while not done.wait(_PAUSE):
        if (held := _held()) > limit:
            sentence = (
                f"This takes {in_gigabytes(held)} of memory by now, more than --max-memory {in_gigabytes(limit)}; give "
                "it more, or use smaller photos or a smaller preset."
            )
            try:
                print(f"lightprobe: {sentence}", file=sys.stderr, flush=True)
                if on_end is not None:
                    on_end(sentence)
            finally:  # whoever was to hear it may have gone
                os._exit(ResourceError.exit_code)

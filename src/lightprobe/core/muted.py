"""Libraries that print what they also report, kept from printing: a sentence of ours says it once."""

import contextlib
import ctypes
import io
import os
import sys
import threading
from collections.abc import Iterator

_ONE_AT_A_TIME = threading.RLock()
_STREAMS = (1, 2)  # standard output and error, as compiled code knows them


@contextlib.contextmanager
def muted() -> Iterator[None]:
    """Drop whatever is printed inside, by Python or past it. Keep it short: other threads are muted as well."""
    with _ONE_AT_A_TIME:
        for stream in (sys.stdout, sys.stderr):  # what was printed before must still come out
            with contextlib.suppress(OSError, ValueError, AttributeError):
                stream.flush()
        with _nowhere(), contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            yield


@contextlib.contextmanager
def _nowhere() -> Iterator[None]:
    """Lead both streams to the null device and back; a closed one stays closed."""
    saved = []
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in _STREAMS:
            with contextlib.suppress(OSError):
                saved.append((stream, os.dup(stream)))
                os.dup2(null, stream)
        yield
    finally:
        _flush_c()
        for stream, copy in saved:
            os.dup2(copy, stream)
            os.close(copy)
        os.close(null)


def _flush_c() -> None:
    """Write out what C's own buffers hold, or it would come out after the streams are led back."""
    if os.name != "nt":
        ctypes.CDLL(None).fflush(None)

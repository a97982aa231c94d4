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
        saved, null = [], os.open(os.devnull, os.O_WRONLY)
        try:
            for number in _STREAMS:
                with contextlib.suppress(OSError):  # a closed one stays closed
                    saved.append((number, os.dup(number)))
                    os.dup2(null, number)
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                yield
        finally:
            if os.name != "nt":  # what C's own buffers hold would come out after the streams are led back
                ctypes.CDLL(None).fflush(None)
            for number, copy in saved:
                os.dup2(copy, number)
                os.close(copy)
            os.close(null)

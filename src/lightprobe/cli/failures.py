"""How failures reach the person at the keyboard: one sentence, an exit code, and no traceback on the screen."""

import contextlib
import sys
import warnings
from collections.abc import Iterator
from typing import TextIO

from lightprobe.core.errors import LightprobeWarning


@contextlib.contextmanager
def own_warnings() -> Iterator[None]:
    """Let only warnings of our own through, one sentence each: those of libraries are about code.

    Filters given to Python itself (`-W`, PYTHONWARNINGS) stand.
    """
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", LightprobeWarning)
        warnings.showwarning = _say
        yield


def _say(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print a warning of ours as one sentence, and any other as Python does."""
    own = issubclass(category, LightprobeWarning)
    words = (
        f"lightprobe: warning: {message}\n"
        if own
        else warnings.formatwarning(message, category, filename, lineno, line)
    )
    print(words, end="", file=file or sys.stderr)

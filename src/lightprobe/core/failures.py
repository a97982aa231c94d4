"""Whatever goes wrong becomes an error of ours, one sentence; unexpected tracebacks go to a file."""

import contextlib
import errno
import tempfile
import traceback
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path

from lightprobe.core.errors import LightprobeError, ResourceError
from lightprobe.core.files import append_text
from lightprobe.core.run import RunFolder

_TOO_MUCH = ("not enough memory", "can't allocate memory")  # what PyTorch says on the CPU, by system
UNEXPECTED = 70  # "internal software error" in BSD's sysexits


class UnexpectedError(LightprobeError):
    """A defect of the program itself; the traceback is in the file that the message names."""

    exit_code = UNEXPECTED


@contextlib.contextmanager
def reporting_errors(log: Path | None = None, keep: Callable[[str], None] | None = None) -> Iterator[None]:
    """Turn whatever goes wrong inside into a `LightprobeError`; an unexpected traceback goes to `log`.

    With `keep`, which is called with it, it goes there alone; without either to a new file in the temporary
    folder. KeyboardInterrupt and SystemExit pass.
    """
    try:
        yield
    except (LightprobeError, BrokenPipeError):
        raise
    except MemoryError as error:
        raise _out_of_memory() from error
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise ResourceError(
                "The disk is full; free some space and run the same command again."
            ) from error
        if error.filename:
            raise ResourceError(f"{error.filename}: {error.strerror or error}.") from error
        raise _unexpected(error, log, keep) from error
    except Exception as error:
        if type(error).__name__ == "OutOfMemoryError" or any(words in str(error) for words in _TOO_MUCH):
            raise _out_of_memory() from error
        raise _unexpected(error, log, keep) from error


@contextlib.contextmanager
def writing(run: RunFolder) -> Iterator[None]:
    """Hold `run` for writing; errors inside are reported as by `reporting_errors`, tracebacks go to the run's
    log.txt.

    Raises `ResourceError` when another process holds it.
    """
    with run.writing(), reporting_errors(run.log_file):
        yield


def _out_of_memory() -> ResourceError:
    return ResourceError("Out of memory: use smaller photos, a smaller preset or other programs closed.")


def _unexpected(error: Exception, log: Path | None, keep: Callable[[str], None] | None) -> UnexpectedError:
    first_line = str(error).strip().split("\n")[0]
    message = f"{type(error).__name__}: {first_line}" if first_line else type(error).__name__
    stamp = datetime.now().isoformat(sep=" ", timespec="seconds")
    text = f"{stamp}  unexpected error\n{''.join(traceback.format_exception(error))}\n"
    if keep is not None:
        keep(text)
        return UnexpectedError(
            f"Unexpected error, please report it with the traceback in the log ({message})."
        )
    try:
        path = _written(text) if log is None else log
        if log is not None:
            append_text(log, text)
    except OSError:
        return UnexpectedError(
            f"Unexpected error, please report it ({message}); no traceback could be written."
        )
    return UnexpectedError(f"Unexpected error, please report it with the traceback in {path} ({message}).")


def _written(text: str) -> Path:
    """Return a new file with `text` in the temporary folder that only its user can read."""
    handle, name = tempfile.mkstemp(prefix="lightprobe-error-", suffix=".txt")
    with open(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
        file.write(text)
    return Path(name)

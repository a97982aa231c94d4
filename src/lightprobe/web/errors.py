"""Why a request is refused or fails, and the HTTP status of each reason."""

from collections.abc import Callable

from lightprobe.core.errors import ConfigError, ConvergenceError, InputError, LightprobeError, ResourceError
from lightprobe.core.failures import UnexpectedError, reporting_errors

MIB = 2**20
"""Bytes."""


class RefusedError(LightprobeError):
    """A request is refused or given up, for a reason that has an HTTP status of its own."""

    def __init__(self, status: int, message: str):
        """Keep the status: 404, 406, 408, 413, 415, 429, 500 or 504."""
        super().__init__(message)
        self.status = status


class WorkerEndedError(ResourceError):
    """The process that computes ended in the middle of a request."""


GONE = 499
"""nginx' status for a client that has closed its connection: the answer reaches nobody but the log."""

_SENT = {
    kind.__name__: kind
    for kind in (InputError, ConfigError, ResourceError, ConvergenceError, UnexpectedError)
}


RETRY_SECONDS = {429: 2, 503: 5}
"""After how many seconds a request that was answered with a status is worth another try."""


def status_of(error: LightprobeError) -> int:
    """Return the HTTP status of an error."""
    if isinstance(error, RefusedError):
        return error.status
    if isinstance(error, InputError | ConfigError):
        return 422
    return 503 if isinstance(error, ResourceError) else 500


def too_large(name: str, limit: int) -> RefusedError:
    """Return the error of a file, or of a body, of more than `limit` bytes that is called `name`."""
    most = (
        f"{limit // MIB} MB" if limit >= MIB else f"{limit // 1024} kB" if limit >= 1024 else f"{limit} bytes"
    )
    return RefusedError(413, f"{name} is too large: at most {most} are taken; choose a smaller file.")


def reported(error: Exception, keep: Callable[[str], None] | None = None) -> LightprobeError:
    """Return whatever went wrong as an error with a sentence; see `core.failures.reporting_errors`."""
    try:
        with reporting_errors(keep=keep):
            raise error
    except LightprobeError as known:
        return known
    except BrokenPipeError:
        return ResourceError("The connection broke.")


def sent_kind(error: LightprobeError) -> str:
    """Return the name under which a worker process tells the kind of an error."""
    return next((name for name, kind in _SENT.items() if isinstance(error, kind)), InputError.__name__)


def received(sentence: str, kind: str) -> LightprobeError:
    """Return the error that a worker process has told."""
    return _SENT.get(kind, InputError)(sentence)

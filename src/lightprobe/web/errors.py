"""Why a request is refused or fails, and the HTTP status of each reason."""

from collections.abc import Callable, Mapping

from lightprobe.core.errors import ConfigError, ConvergenceError, InputError, LightprobeError, ResourceError
from lightprobe.core.failures import UnexpectedError, reporting_errors

MIB = 2**20
"""Bytes."""


class TooLargeError(LightprobeError):
    """A file, or the body of a request, is larger than it may be."""

    @staticmethod
    def of(name: str, limit: int) -> "TooLargeError":
        """Return the error of a file of more than `limit` bytes that is called `name`."""
        most = (
            f"{limit // MIB} MB"
            if limit >= MIB
            else f"{limit // 1024} kB"
            if limit >= 1024
            else f"{limit} bytes"
        )
        return TooLargeError(f"{name} is too large: at most {most} are taken; choose a smaller file.")


class SlowClientError(LightprobeError):
    """A request did not arrive in time."""


class MediaTypeError(LightprobeError):
    """A request has a body of a kind that is not taken."""


class NotAcceptableError(LightprobeError):
    """A request asks for an answer of a kind that is not made."""


class UnknownObjectError(LightprobeError):
    """There is no object of this name."""


class TooManyRequestsError(ResourceError):
    """Too many requests wait, or are being sent, already."""


class DeadlineError(ResourceError):
    """A request took longer than it may."""


class WorkerEndedError(ResourceError):
    """The process that computes ended in the middle of a request."""


class WorkerLostError(LightprobeError):
    """A request has ended two workers, or one by taking too much memory."""


STATUS: Mapping[type[LightprobeError], int] = {
    UnknownObjectError: 404,
    NotAcceptableError: 406,
    SlowClientError: 408,
    TooLargeError: 413,
    MediaTypeError: 415,
    TooManyRequestsError: 429,
    DeadlineError: 504,
    UnexpectedError: 500,
    WorkerLostError: 500,
    ConvergenceError: 500,
    ResourceError: 503,
    InputError: 422,
    ConfigError: 422,
}
"""HTTP status of errors: the first that an error is an instance of."""

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
    return next((code for kind, code in STATUS.items() if isinstance(error, kind)), 400)


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

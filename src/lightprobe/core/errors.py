"""Every error a user can cause or meet: one root, one sentence each, no traceback at the command line.

A message says what is wrong, where (file, key, photo), and what to do about it.
"""

import reprlib

INTERRUPTED = 130  # exit code, what shells report for a program ended by Ctrl-C

_LONGEST = 120  # characters of a value that a message quotes
_SHORT = reprlib.Repr()
# Characters and levels of a value that a sentence quotes
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxlong, _SHORT.maxother = 3, 60, 40, 60


def printable(text: str) -> str:
    """Return `text` as one line for any terminal: what cannot be printed is escaped."""
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def shown(value: object) -> str:
    """Return a value out of a file as a message may quote it, text without quotes, cut where it is too long."""
    text = value if isinstance(value, str) else _SHORT.repr(value)
    return printable(text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}...")


class LightprobeError(Exception):
    """Root of all expected failures; the command line prints its message and exits with `exit_code`."""

    exit_code = 1

    def __init__(self, message: str):
        super().__init__(printable(message))


class InputError(LightprobeError):
    """A file, folder, camera, mask or image given by the user is missing, damaged or contradictory."""

    exit_code = 2


class ConfigError(LightprobeError):
    """An option or a stored configuration has a value that cannot be used."""

    exit_code = 3


class ResourceError(LightprobeError):
    """The machine ran out of something: disk, memory, device, permission."""

    exit_code = 4


class LockedError(ResourceError):
    """Another process holds what this one wants to write; it can be tried again."""


class ConvergenceError(LightprobeError):
    """The optimisation produced nothing usable, such as an empty mesh or non-finite values."""

    exit_code = 5


class LightprobeWarning(UserWarning):
    """Something that does not stop a command but spoils what comes out of it; one sentence, as an error's."""

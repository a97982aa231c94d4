"""Every error a user can cause or meet: one root, one sentence each, no traceback at the command line.

A message says what is wrong, where (file, key, photo), and what to do about it.
"""


class LightprobeError(Exception):
    """Root of all expected failures; the command line prints its message and exits with `exit_code`."""

    exit_code = 1


class InputError(LightprobeError):
    """A file, folder, camera, mask or image given by the user is missing, damaged or contradictory."""

    exit_code = 2


class ConfigError(LightprobeError):
    """An option or a stored configuration has a value that cannot be used."""

    exit_code = 3


class ResourceError(LightprobeError):
    """The machine ran out of something: disk, memory, device, permission."""

    exit_code = 4


class ConvergenceError(LightprobeError):
    """The optimisation produced nothing usable, such as an empty mesh or non-finite values."""

    exit_code = 5


class LightprobeWarning(UserWarning):
    """Something that does not stop a command but spoils what comes out of it; one sentence, as an error's."""

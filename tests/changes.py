"""Changes of the file system as the interpreter's audit events tell them."""

import os

_DIRECTORY = {"os.rename": 2, "os.mkdir": 2, "os.remove": 1, "os.rmdir": 1, "os.link": 2, "os.symlink": 2}
"""Where each event tells the open directory that its path begins at, -1 for the working directory."""
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_TRUNC


def changed_path(event: str, arguments: tuple) -> str | None:
    """Return the absolute path that an event (`sys.addaudithook`) changes, None for one that changes nothing.

    Writing into an open file is none: it was counted when the file was opened.
    """
    opens = event == "open" and bool((arguments[2] or 0) & _WRITING)
    if not opens and event != "os.truncate" and event not in _DIRECTORY:
        return None
    path = arguments[0]
    if not isinstance(path, str | bytes | os.PathLike):
        return None
    directory = arguments[_DIRECTORY[event]] if event in _DIRECTORY else -1
    start = os.readlink(f"/proc/self/fd/{directory}") if directory >= 0 else ""
    return os.path.abspath(os.path.join(start, os.fsdecode(path)))

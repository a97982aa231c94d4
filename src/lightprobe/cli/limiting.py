"""The option --max-memory, which all commands take that work in their own process."""

from collections.abc import Sequence

from lightprobe.core.errors import ConfigError
from lightprobe.core.memory_limit import parse_size

OPTION = "--max-memory"
ELSEWHERE = frozenset(
    {"serve", "view", "fleet train", "fleet predict"}
)  # commands that have processes of their own


def limit_among(name: str, arguments: Sequence[str]) -> tuple[list[str], int | None]:
    """Return a command's arguments without the option, and the bytes that it allows, None where it is not
    there.

    Raises `ConfigError` for a value that is no size, and for a command that works in other processes.
    """
    kept, size, words = list[str](), None, iter(arguments)
    for word in words:
        if word == OPTION:
            size = next(words, "")
        elif word.startswith(f"{OPTION}="):
            size = word.partition("=")[2]
        else:
            kept.append(word)
    if size is not None and name in ELSEWHERE:
        raise ConfigError(
            f"{OPTION} holds one process, and {name} works in several; limit the size of photos with "
            "--max-megapixels of serve, or the memory of all with your system (containers, systemd-run)."
        )
    return kept, None if size is None else parse_size(size)

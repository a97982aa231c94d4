"""The program as torchrun starts it, watched: the second process may write nothing into the run, or dies on
the way.

    torchrun --nproc-per-node 2 tests/cli/watched_program.py RUN EXCHANGES distill RUN ...

After so many exchanges the second process is killed; 0: never.
"""

import os
import signal
import sys
from typing import Any

import torch.distributed as dist

from lightprobe.cli.main import main

WROTE = 99  # exit code of a process that writes what it must not
_CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.truncate", "os.chmod", "os.utime"}
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT


def watch(run: str) -> None:
    """End the process where it changes anything in the folder `run`."""

    def hear(event: str, given: tuple[Any, ...]) -> None:
        changes = event in _CHANGES or (event == "open" and given[2] & _WRITING)
        if changes and os.path.abspath(os.fsdecode(given[0])).startswith(os.path.abspath(run)):
            os.write(2, f"lightprobe: {event} of {given[0]}\n".encode())
            os._exit(WROTE)

    sys.addaudithook(hear)


def die_after(exchanges: int) -> None:
    """Kill the process in place of one of its exchanges."""
    exchange, done = dist.all_reduce, [0]

    def counted(*given: Any, **named: Any) -> Any:
        done[0] += 1
        if done[0] == exchanges:
            os.kill(os.getpid(), signal.SIGKILL)
        return exchange(*given, **named)

    dist.all_reduce = counted


if __name__ == "__main__":
    if os.environ["RANK"] == "1":
        watch(sys.argv[1])
        die_after(int(sys.argv[2]))
    sys.exit(main(sys.argv[3:]))

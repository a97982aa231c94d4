"""The process that computes, seen from the server: JSON lines to it and back."""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

from lightprobe.core.errors import InputError, ResourceError


class WorkerEndedError(ResourceError):
    """The process ended in the middle of a job."""


def worker_command(device: str) -> tuple[str, ...]:
    """Return the command of a worker that computes on `device`."""
    return sys.executable, "-P", "-m", "lightprobe.view.worker", device


class WorkerProcess:
    """A process of `view.worker`."""

    def __init__(self, command: Sequence[str]):
        """Start it; in a session of its own, so that Ctrl-C reaches the server alone."""
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )  # fmt: skip

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        return self._process.poll() is None

    def ask(self, request: dict[str, Any], on_stage: Callable[[str], None]) -> dict[str, Any]:
        """Return the answer to a request; raise `InputError` with its sentence, or `WorkerEndedError`."""
        if self._process.stdin is None or self._process.stdout is None:
            raise ValueError("Opened with pipes.")
        try:
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
            self._process.stdin.flush()
            for line in self._process.stdout:
                said = json.loads(line)
                if "stage" in said:
                    on_stage(said["stage"])
                elif "error" in said:
                    raise InputError(said["error"])
                else:
                    return said["result"]
        except (OSError, ValueError):
            self.kill()
        raise WorkerEndedError(
            "The process that computes has ended, perhaps for want of memory; try again, it is started anew."
        )

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()
        self._process.wait()

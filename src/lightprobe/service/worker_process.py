"""A process that computes, seen from its server: JSON lines to it and back. `service.worker_loop` is its
other end.
"""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import IO, Any

from lightprobe.core.errors import printable
from lightprobe.service.errors import WorkerEndedError, received

_ENDED = "The process that computes has ended, perhaps for want of memory; try again, it is started anew."


def worker_command(module: str, *arguments: str) -> tuple[str, ...]:
    """Return the command of a worker whose main function is that of `module`."""
    return sys.executable, "-P", "-m", module, *arguments


class WorkerProcess:
    """A process that answers one request after the other."""

    def __init__(
        self,
        command: Sequence[str],
        *,
        environment: Mapping[str, str] | None = None,
        on_text: Callable[[str], None] | None = None,
    ):
        """Start it; in a session of its own, so that Ctrl-C reaches the server alone.

        environment: variables beside those of this process. on_text: takes the lines it writes to standard
        error, which else is that of this process.
        """
        errors = None if on_text is None else subprocess.PIPE
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,
            env={**os.environ, **(environment or {})},
        )
        if on_text is not None and self._process.stderr is not None:
            threading.Thread(target=_forward, args=(self._process.stderr, on_text), daemon=True).start()

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        return self._process.poll() is None

    def ask(self, request: dict[str, Any], on_stage: Callable[[str], None]) -> dict[str, Any]:
        """Return the answer to a request.

        Raises the error that it tells (`service.errors.received`), or `WorkerEndedError`.
        """
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
                    raise received(said["error"], said.get("kind", ""))
                else:
                    result: dict[str, Any] = said["result"]
                    return result
        except (OSError, ValueError):
            pass
        self.kill()  # it may have closed its pipe and not ended yet
        raise WorkerEndedError(_ENDED)

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()
        self._process.wait()


def _forward(stream: IO[bytes], on_text: Callable[[str], None]) -> None:
    with stream:
        for line in stream:
            on_text(printable(line.decode("utf-8", "replace").rstrip()))

"""A process that computes for a server: JSON lines to it and back, seen from both ends.

    {"task": "start"}          ->  {"result": {"ready": true}}, once the process can be asked
    {"task": "predict", ...}   ->  {"stage": "..."} any number of times, then {"result": {...}} or
                                   {"error": "sentence", "kind": "InputError"}

The process ends with its input, and so with the server.
"""

import json
import os
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import IO, Any

from lightprobe.core.errors import LightprobeError, LightprobeWarning, printable
from lightprobe.core.failures import reporting_errors
from lightprobe.web.errors import WorkerEndedError, received, sent_kind

START = {"task": "start"}
"""What a new process is asked first."""

Tell = Callable[[str], None]
Answer = Callable[[dict[str, Any], Tell], dict[str, Any]]
Reworded = Callable[[dict[str, Any], str], str]

_ENDED = "The process that computes has ended, perhaps for want of memory; try again, it is started anew."


def worker_command(module: str, *arguments: str) -> tuple[str, ...]:
    """Return the command of a process whose main function is that of `module`."""
    return sys.executable, "-P", "-m", module, *arguments


class WorkerProcess:
    """A process that answers one request after the other, seen from its server."""

    def __init__(
        self,
        command: Sequence[str],
        *,
        environment: Mapping[str, str] | None = None,
        on_text: Callable[[str], None] | None = None,
    ):
        """Start the process; in a session of its own, so that Ctrl-C reaches the server alone.

        environment: variables beside those of this process. on_text: takes the lines that the process writes
        to standard error, which else is that of this process.
        """
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=None if on_text is None else subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, **(environment or {})},
        )
        if on_text is not None and self._process.stderr is not None:
            threading.Thread(target=_forward, args=(self._process.stderr, on_text), daemon=True).start()

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process can be asked."""
        return self._process.poll() is None

    def ask(self, request: dict[str, Any], on_stage: Tell) -> dict[str, Any]:
        """Return the answer to a request.

        Raises the error that the process tells (`web.errors.received`), or `WorkerEndedError`.
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
        """End the process at once."""
        self._process.kill()
        self._process.wait()


def _forward(stream: IO[bytes], on_text: Callable[[str], None]) -> None:
    with stream:
        for line in stream:
            on_text(printable(line.decode("utf-8", "replace").rstrip()))


def answer_requests(
    answer: Answer,
    reworded: Reworded = lambda request, sentence: sentence,
    keep: Callable[[str], None] | None = None,
) -> None:
    """Answer requests in the process until there are no more.

    The result of `answer` gets the list "warnings", a sentence each. reworded: says a sentence so that the
    person who asked knows the files in it. keep: takes unexpected tracebacks, see
    `core.failures.reporting_errors`.
    """
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer

    def say(message: dict[str, Any]) -> None:
        out.write(json.dumps(message, allow_nan=False).encode() + b"\n")
        out.flush()

    for line in sys.stdin.buffer:
        request = json.loads(line)
        if request == START:
            say({"result": {"ready": True}})
            continue
        try:
            with reporting_errors(keep=keep), warnings.catch_warnings(record=True) as heard:
                warnings.simplefilter("always", LightprobeWarning)
                result = answer(request, lambda stage: say({"stage": stage}))
            ours = [str(one.message) for one in heard if issubclass(one.category, LightprobeWarning)]
            say({"result": {**result, "warnings": [reworded(request, sentence) for sentence in ours]}})
        except LightprobeError as error:
            say({"error": reworded(request, str(error)), "kind": sent_kind(error)})

"""The other end of `service.worker_process`: a request on each line of the input, JSON lines out.

    {"task": "predict", ...}  ->  {"stage": "..."} any number of times, then {"result": {...}} or
                                  {"error": "sentence", "kind": "InputError"}

A worker ends with its input, and so with the server.
"""

import json
import os
import sys
import warnings
from collections.abc import Callable
from typing import Any

from lightprobe.core.errors import LightprobeError, LightprobeWarning
from lightprobe.core.failures import reporting_errors
from lightprobe.service.errors import sent_kind

Tell = Callable[[str], None]
Answer = Callable[[dict[str, Any], Tell], dict[str, Any]]
Say = Callable[[dict[str, Any]], None]
Reworded = Callable[[dict[str, Any], str], str]


def answer_requests(
    answer: Answer,
    reworded: Reworded = lambda request, sentence: sentence,
    keep: Callable[[str], None] | None = None,
) -> None:
    """Answer requests until there are no more.

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
        try:
            result, heard = _result(answer, request, lambda stage: say({"stage": stage}), keep)
            say({"result": {**result, "warnings": [reworded(request, sentence) for sentence in heard]}})
        except LightprobeError as error:
            say({"error": reworded(request, str(error)), "kind": sent_kind(error)})


def _result(
    answer: Answer, request: dict[str, Any], tell: Tell, keep: Callable[[str], None] | None
) -> tuple[dict[str, Any], list[str]]:
    """Return the result of a request and our own warnings meanwhile."""
    with reporting_errors(keep=keep), warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always", LightprobeWarning)
        result = answer(request, tell)
    return result, [str(one.message) for one in heard if issubclass(one.category, LightprobeWarning)]

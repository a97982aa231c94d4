"""The process that computes, started by `view.worker_process`: a request on each line of its input, JSON lines out.

    {"task": "predict", ...}  ->  {"stage": "..."} any number of times, then {"result": {...}} or {"error": "sentence"}

It ends with its input, and so with the server.
"""

import json
import os
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import LightprobeError, LightprobeWarning
from lightprobe.core.failures import reporting_errors
from lightprobe.view.forming import FormingObjects
from lightprobe.view.inserting import insert_thing
from lightprobe.view.jobs import TaskName
from lightprobe.view.predicting import Models, load, predict
from lightprobe.view.uploads import renamed

Tell = Callable[[str], None]


class Tasks:
    """What can be asked for, and what is kept between requests."""

    def __init__(self, device: str):
        where = resolve_device(device)
        self._models, self._forming = Models(where), FormingObjects(where)

    def answer(self, request: dict[str, Any], tell: Tell) -> dict[str, Any]:
        """Return the result of a request; raise `LightprobeError` when it cannot be had."""
        match TaskName(request["task"]):
            case TaskName.PREDICT:
                return predict(self._models, request, tell)
            case TaskName.INSERT:
                return insert_thing(self._models, request, tell)
            case TaskName.LOAD:
                return load(self._models, request)
            case TaskName.FORMING:
                return self._forming.write(Path(request["run"]), Path(request["folder"]), tell)


def main() -> None:
    """Answer requests until there are no more."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    tasks = Tasks(sys.argv[1])
    for line in sys.stdin.buffer:
        _answer(tasks, json.loads(line), out)


def _answer(tasks: Tasks, request: dict[str, Any], out: BinaryIO) -> None:
    def say(message: dict[str, Any]) -> None:
        out.write(json.dumps(message, allow_nan=False).encode() + b"\n")
        out.flush()

    try:
        with reporting_errors(), warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always", LightprobeWarning)
            result = tasks.answer(request, lambda stage: say({"stage": stage}))
    except LightprobeError as error:
        upload, name = request.get("upload"), request.get("name", "")
        say({"error": str(error) if upload is None else renamed(str(error), Path(upload), name)})
        return
    own = [str(warning.message) for warning in heard if issubclass(warning.category, LightprobeWarning)]
    say({"result": {**result, "warnings": own}})


if __name__ == "__main__":
    main()

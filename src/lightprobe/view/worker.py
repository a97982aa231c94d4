"""The process that computes for the page, see `service.worker_loop`: what can be asked of it."""

import sys
from pathlib import Path
from typing import Any

from lightprobe.core.device import resolve_device
from lightprobe.jobs import Sessions
from lightprobe.service.incoming import renamed
from lightprobe.service.worker_loop import Tell, answer_requests
from lightprobe.view.forming import FormingObjects
from lightprobe.view.inserting import insert_thing
from lightprobe.view.jobs import TaskName
from lightprobe.view.predicting import load, predict


class Tasks:
    """What can be asked for, and what is kept between requests."""

    def __init__(self, device: str):
        where = resolve_device(device)
        self._runs, self._forming = (
            Sessions(where, most=1),
            FormingObjects(where),
        )  # two need not be held at once

    def answer(self, request: dict[str, Any], tell: Tell) -> dict[str, Any]:
        """Return the result of a request; raise `LightprobeError` when it cannot be had."""
        match TaskName(request["task"]):
            case TaskName.PREDICT:
                return predict(self._runs, request, tell)
            case TaskName.INSERT:
                return insert_thing(self._runs, request, tell)
            case TaskName.LOAD:
                return load(self._runs, request)
            case TaskName.FORMING:
                return self._forming.write(Path(request["run"]), Path(request["folder"]), tell)


def main() -> None:
    """Answer requests until there are no more."""
    answer_requests(Tasks(sys.argv[1]).answer, _reworded)


def _reworded(request: dict[str, Any], sentence: str) -> str:
    upload = request.get("upload")
    return sentence if upload is None else renamed(sentence, {Path(upload): request.get("name", "")})


if __name__ == "__main__":
    main()

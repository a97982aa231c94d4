"""The process that computes for the page, see `web.worker`: what can be asked of it."""

import sys
from pathlib import Path
from typing import Any

from lightprobe.core.device import resolve_device
from lightprobe.jobs import Sessions
from lightprobe.view.checkpoint_preview import CheckpointPreviews
from lightprobe.view.inserting import insert_thing
from lightprobe.view.predicting import load, predict
from lightprobe.view.tasks import TaskKind
from lightprobe.web.uploads import renamed
from lightprobe.web.worker import Tell, answer_requests


def main() -> None:
    """Answer requests until there are no more; the argument is the device to compute on."""
    device = resolve_device(sys.argv[1])
    runs, previews = (
        Sessions(device, most=1),
        CheckpointPreviews(device),
    )  # two runs need not be held at once

    def answer(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
        match TaskKind(request["task"]):
            case TaskKind.PREDICT:
                return predict(runs, request, tell)
            case TaskKind.INSERT:
                return insert_thing(runs, request, tell)
            case TaskKind.LOAD:
                return load(runs, request)
            case TaskKind.PREVIEW:
                return previews.write(Path(request["run"]), Path(request["folder"]), tell)

    answer_requests(answer, _reworded)


def _reworded(request: dict[str, Any], sentence: str) -> str:
    upload = request.get("upload")
    return sentence if upload is None else renamed(sentence, {Path(upload): request.get("name", "")})


if __name__ == "__main__":
    main()

"""What stands in for the processes that compute: answers at once; what a photo is called says what becomes of
it.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from lightprobe.service.errors import WorkerEndedError, received

_ERRORS = {"fails": "InputError", "full": "ResourceError", "breaks": "UnexpectedError"}


class StandIn:
    """In the place of `service.worker_process.WorkerProcess`, for the service and for the page."""

    deaths = 0  # of all of them
    reasons: set[str] = set()  # noqa: RUF012  kinds of the errors that were told

    def __init__(
        self,
        command: Sequence[str],
        *,
        environment: Mapping[str, str] | None = None,
        on_text: Callable[[str], None] | None = None,
    ):
        """Take what a process would be started with."""
        self.pid, self.alive = os.getpid(), True

    def ask(self, request: dict[str, Any], on_stage: Callable[[str], None]) -> dict[str, Any]:
        """Return what a prediction would leave, or raise what one would."""
        request = json.loads(json.dumps(request))  # as it goes through a pipe
        if request["task"] in ("start", "load"):
            return {"ready": True}
        on_stage("at work")
        what = str(request["name"]).partition(".")[0]
        if what == "dies" or (what == "once" and StandIn.deaths % 2 == 0):
            StandIn.deaths += 1
            self.kill()
            raise WorkerEndedError("The process has ended.")
        if what in _ERRORS:
            StandIn.reasons.add(_ERRORS[what])
            raise received("This cannot be done.", _ERRORS[what])
        return self._of_service(request) if "outputs" in request else self._of_page(request)

    def kill(self) -> None:
        """End it."""
        self.alive = False

    @staticmethod
    def _of_service(request: dict[str, Any]) -> dict[str, Any]:
        from lightprobe.jobs import AnswerFiles, Output

        folder, outputs = Path(request["folder"]), [Output(output) for output in request["outputs"]]
        names = [path.name for path in AnswerFiles.within(folder, outputs).paths.values()]
        for path in (request["photo"], request["mask"], request["camera"]):
            if path is not None and not Path(path).resolve().is_relative_to(folder.resolve()):
                raise AssertionError("a file of a request outside its folder")
        for name in names:
            (folder / name).write_bytes(b"map")
        return {
            "method": request["method"] or "solve",
            "verdict": {"status": "good"},
            "pose": None,
            "warnings": [],
            "light": {"asked": request},
            "files": names,
            "seconds": {"all": 0.01},
            "worker": {"objects": ["cup"]},
        }

    @staticmethod
    def _of_page(request: dict[str, Any]) -> dict[str, Any]:
        (Path(request["folder"]) / "light.exr").write_bytes(b"no map")
        return {"files": [{"name": "light.exr", "title": "light"}]}

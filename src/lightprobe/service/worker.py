"""The process that computes for the service, see `web.worker`: predictions, with objects that stay loaded.

Every result has "worker": what the process keeps and how much.
"""

import contextlib
import os
import sys
from pathlib import Path
from typing import Any

import torch

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import InputError, LightprobeError, printable
from lightprobe.core.failures import reporting_errors
from lightprobe.core.memory import resident_bytes
from lightprobe.imaging import image_size
from lightprobe.jobs import AnswerFiles, PredictRequest, Sessions, predict_photo
from lightprobe.service.objects import Objects
from lightprobe.web.uploads import renamed
from lightprobe.web.worker import Tell, answer_requests


class Worker:
    """What can be asked for, and what is kept between requests."""

    def __init__(self, device: str, threads: int, cache: int, max_pixels: int):
        """Compute on `device` with `threads`; keep `cache` bytes of objects, take photos of up to `max_pixels`."""
        torch.set_num_threads(threads)
        self._sessions, self._max_pixels = Sessions(resolve_device(device), memory=cache), max_pixels

    def warm_up(self, runs: Path) -> None:
        """Get ready with the first object of a folder; one that cannot be used is left to the request for it."""
        with contextlib.suppress(LightprobeError), reporting_errors(keep=_keep):
            for entry in Objects(runs).after("", 1).objects:
                self._sessions.get(runs / entry.name).warm_up()

    def answer(self, task: dict[str, Any], tell: Tell) -> dict[str, Any]:
        """Predict the light in the photo of a task, and write the wanted files into the task's folder.

        Returns what the answer says of them. Raises `InputError` for files that cannot be used, a photo without
        the object and one that no light explains.
        """
        request, sessions = PredictRequest.from_json(task), self._sessions
        for file in (request.photo, request.mask):
            if file is not None:
                self._check_size(file)
        tell("loading the object")
        loads, session = sessions.loads, sessions.get(task["run"])
        files = AnswerFiles.within(Path(task["folder"]), request.outputs)
        answer = predict_photo(session, request, files, tell)
        told = answer.to_json()
        names = [Path(path).name for path in told["files"].values()]
        seconds = {"load": session.seconds if sessions.loads > loads else 0.0, **told["seconds"]}
        kept = {
            "held": sessions.trim(),  # first: it lets some go
            "objects": [Path(path).name for path in sessions.paths],
            "loads": sessions.loads,
            "evictions": sessions.evictions,
            "resident": resident_bytes(os.getpid()),
        }
        return {**told, "light": answer.light, "files": names, "seconds": seconds, "worker": kept}

    def _check_size(self, file: Path) -> None:
        width, height = image_size(file)
        if width * height > self._max_pixels:
            raise InputError(
                f"{file} has {width} x {height} pixels, more than the {self._max_pixels / 1e6:.0f} million that are "
                "taken here; scale it down."
            )


def reworded(request: dict[str, Any], sentence: str) -> str:
    """Return a sentence without the places that files have here."""
    names = {Path(request["photo"]): str(request["name"]), Path(request["run"]): Path(request["run"]).name}
    if request["mask"] is not None:
        names[Path(request["mask"])] = "the mask"
    if request["camera"] is not None:
        names[Path(request["camera"])] = "the camera"
    return renamed(sentence, names).replace(request["folder"], "")


def main() -> None:
    """Answer requests until there are no more; the arguments are those of `Worker`."""
    runs, device, threads, cache, max_pixels = sys.argv[1:]
    worker = Worker(device, int(threads), int(cache), int(max_pixels))
    worker.warm_up(Path(runs))
    answer_requests(worker.answer, reworded, _keep)


def _keep(text: str) -> None:
    """Write an unexpected traceback where the service logs it."""
    print(printable(text), file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()

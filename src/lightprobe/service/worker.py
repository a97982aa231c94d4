"""The process that computes for the service, see `web.worker`: predictions, with objects that stay loaded.

Every result has "worker": what the process keeps and how much.
"""

import os
import sys
from pathlib import Path
from typing import Any

import torch

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import printable
from lightprobe.core.memory import resident_bytes
from lightprobe.jobs import Sessions
from lightprobe.service.predicting import predict
from lightprobe.web.uploads import renamed
from lightprobe.web.worker import Tell, answer_requests


class Worker:
    """What can be asked for, and what is kept between requests."""

    def __init__(self, device: str, threads: int, cache: int, max_pixels: int):
        """Compute on `device` with `threads`; keep `cache` bytes of objects, take photos of up to
        `max_pixels`.
        """
        torch.set_num_threads(threads)
        self._runs, self._max_pixels = Sessions(resolve_device(device), memory=cache), max_pixels

    def answer(self, request: dict[str, Any], tell: Tell) -> dict[str, Any]:
        """Return the result of a request; raise `LightprobeError` when it cannot be had."""
        result = predict(self._runs, request, self._max_pixels, tell)
        held = self._runs.trim()
        return {
            **result,
            "worker": {
                "objects": [Path(path).name for path in self._runs.paths],
                "held": held,
                "loads": self._runs.loads,
                "evictions": self._runs.evictions,
                "resident": resident_bytes(os.getpid()),
            },
        }


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
    device, threads, cache, max_pixels = sys.argv[1:]
    worker = Worker(device, int(threads), int(cache), int(max_pixels))
    answer_requests(worker.answer, reworded, lambda text: print(printable(text), file=sys.stderr, flush=True))


if __name__ == "__main__":
    main()

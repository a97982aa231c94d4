"""One request's prediction, in the worker: the request read from JSON, and the answer told as JSON."""

from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.imaging import image_size
from lightprobe.jobs import AnswerFiles, PredictRequest, Sessions, predict_photo
from lightprobe.web.worker import Tell


def predict(runs: Sessions, task: dict[str, Any], max_pixels: int, tell: Tell) -> dict[str, Any]:
    """Predict the light in the photo of a request, and write the wanted files into the folder of the task.

    max_pixels: that a photo or mask may have. Returns what the answer says of it. Raises `InputError` for
    files that cannot be used, a photo without the object and one that no light explains.
    """
    request = PredictRequest.from_json(task)
    for file in (request.photo, request.mask):
        if file is not None:
            _check_size(file, max_pixels)
    tell("loading the object")
    loads, session = runs.loads, runs.get(task["run"])
    files = AnswerFiles.within(Path(task["folder"]), request.outputs)
    answer = predict_photo(session, request, files, tell)
    told = answer.to_json()
    seconds = {"load": session.seconds if runs.loads > loads else 0.0, **told["seconds"]}
    names = [Path(path).name for path in told["files"].values()]
    return {**told, "light": answer.light, "files": names, "seconds": seconds}


def _check_size(file: Path, max_pixels: int) -> None:
    width, height = image_size(file)
    if width * height > max_pixels:
        raise InputError(
            f"{file} has {width} x {height} pixels, more than the {max_pixels / 1e6:.0f} million that are taken here; "
            "scale it down."
        )

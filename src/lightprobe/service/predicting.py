"""One request's prediction, in the worker: the files it asks for, and what is known of them."""

import time
from pathlib import Path
from typing import Any

from lightprobe.core.config.prediction import Method, Sun
from lightprobe.core.errors import InputError
from lightprobe.core.files import read_json, write_bytes
from lightprobe.core.run import RunFolder
from lightprobe.export.light_file import PhotoFacts, write_light_file
from lightprobe.imaging import image_size, write_mask
from lightprobe.light.files import light_file
from lightprobe.prediction import Prediction, methods_for
from lightprobe.runs.loaded import LoadedRun, LoadedRuns
from lightprobe.runs.locations import LocationFiles
from lightprobe.runs.new_photos import NewPhoto, PhotoFiles
from lightprobe.service.asked import FILES, Output
from lightprobe.web.worker import Tell


def predict(runs: LoadedRuns, request: dict[str, Any], max_pixels: int, tell: Tell) -> dict[str, Any]:
    """Predict the light in the photo of a request, and write the files it asks for into its folder.

    max_pixels: that a photo or mask may have. Returns what the answer says of it. Raises `InputError` for
    files that cannot be used, a photo without the object and one that no light explains.
    """
    begin = time.perf_counter()
    run, folder = RunFolder.open(Path(request["run"])), Path(request["folder"])
    image, camera, mask = (
        None if (path := request[key]) is None else Path(path) for key in ("photo", "camera", "mask")
    )
    if image is None:
        raise ValueError("Checked when it came in.")
    for file in (image, mask):
        if file is not None:
            _check_size(file, max_pixels)
    tell("loading")
    loads, loaded = runs.loads, runs.get(run)
    seconds = loaded.seconds if runs.loads > loads else 0.0
    files = PhotoFiles(
        image, mask, LocationFiles(*(folder / name for name in ("camera.json", "mask.png", "overlay.png")))
    )
    whole = Output.MASK in request["outputs"]
    photo = loaded.read(files, camera, background=request["background"], whole=whole, tell=tell)
    tell("predicting")
    method, prediction = _predicted(loaded, photo, request)
    tell("writing")
    _write(prediction, photo, request, folder)
    told = _told(photo, prediction, method, read_json(light_file(folder / FILES[Output.EXR])))
    timings = {
        "load": seconds,
        "locate": _located(photo),
        **prediction.seconds,
        "all": time.perf_counter() - begin,
    }
    return {**told, "files": _files(request, folder), "seconds": timings}


def _check_size(file: Path, max_pixels: int) -> None:
    width, height = image_size(file)
    if width * height > max_pixels:
        raise InputError(
            f"{file} has {width} x {height} pixels, more than the {max_pixels / 1e6:.0f} million that are taken here; "
            "scale it down."
        )


def _predicted(loaded: LoadedRun, photo: NewPhoto, request: dict[str, Any]) -> tuple[Method, Prediction]:
    predictor = loaded.predictor
    asked = request["method"]
    method = methods_for(predictor.model, predictor.config)[0] if asked is None else Method(asked)
    return method, predictor.predict(
        photo.pixels,
        photo.pixel_camera,
        method,
        background=photo.background,
        doubt=photo.doubt,
        sources=request["sources"],
    )


def _write(prediction: Prediction, photo: NewPhoto, request: dict[str, Any], folder: Path) -> None:
    outputs, sun, height = (
        {Output(name) for name in request["outputs"]},
        Sun(request["sun"]),
        request["height"],
    )
    light = prediction.map(sun)
    maps = [FILES[output] for output in (Output.EXR, Output.HDR) if output in outputs]
    for name in maps:
        light.save(folder / name, height)
    if Output.PNG in outputs:
        write_bytes(folder / FILES[Output.PNG], light._repr_png_())
    if Output.CONFIDENCE in outputs:
        prediction.save_confidence(folder / FILES[Output.CONFIDENCE])
    if Output.MASK in outputs and photo.location is None:
        write_mask(folder / FILES[Output.MASK], photo.pixels.alpha)
    name, *copies = maps or [FILES[Output.EXR]]
    facts = PhotoFacts(request["name"], photo.camera, photo.ev100)
    write_light_file(folder / name, prediction, facts, sun, height, copies)


def _files(request: dict[str, Any], folder: Path) -> list[str]:
    """Return the names of the files that were asked for; an overlay is there only where the object was looked
    for.
    """
    return [name for output in request["outputs"] if (folder / (name := FILES[Output(output)])).is_file()]


def _located(photo: NewPhoto) -> float:
    return 0.0 if photo.location is None else photo.location.located.seconds


def _told(photo: NewPhoto, prediction: Prediction, method: Method, light: dict[str, Any]) -> dict[str, Any]:
    pose = None if photo.location is None else photo.location.located.verdict.to_json()
    return {"method": method, "verdict": prediction.verdict.to_json(), "pose": pose, "light": light}

"""The process that computes for the page, see `web.worker`: what it can be asked for, and the files that it leaves.

A task says "run" and "folder", where its files go; of a file that came in "upload" and "name".
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch

from lightprobe.core.device import resolve_device
from lightprobe.core.files import read_json, write_bytes
from lightprobe.evaluation import relight
from lightprobe.evaluation.three_spheres import ThreeSpheres
from lightprobe.export import write_picture
from lightprobe.imaging import read_ldr, read_mask, write_png
from lightprobe.insertion import LayerFiles, PhotoView, Placement, insert, load_virtual_object
from lightprobe.jobs import Answer, AnswerFiles, Output, PredictRequest, Sessions, predict_photo
from lightprobe.jobs.insertion import doubt_about_up
from lightprobe.light.environment import Environment
from lightprobe.light.files import plane
from lightprobe.prediction.confidence import confidence_colors
from lightprobe.preparation.correcting import click_mask, correct_masks, forget_correction
from lightprobe.scene.background import is_opaque
from lightprobe.scene.camera import Camera
from lightprobe.view.checkpoint_preview import CheckpointPreviews
from lightprobe.view.pictures import SIDE, jpeg
from lightprobe.view.tasks import TaskKind
from lightprobe.web.uploads import renamed
from lightprobe.web.worker import Tell, answer_requests

_BALL = 192  # pixels across a ball
_MAP, _INSERTED = "light.exr", "inserted.png"
_TITLES = {
    "photo.jpg": "photo",
    "overlay.png": "the object's outline in the photo",
    "mask.png": "mask",
    "camera.json": "camera",
    _MAP: "environment map, OpenEXR",
    "light.hdr": "environment map, Radiance HDR",
    "light.light.json": "the light in numbers: lamps, harmonics, exposure",
    "light.png": "environment map, picture",
    "confidence.exr": "confidence, OpenEXR",
    "confidence.png": "confidence, picture",
    "balls.png": "diffuse, matte and mirror ball",
    "render.png": "the object under this light",
    _INSERTED: "the photo with it",
    "inserted.beauty.exr": "the virtual object alone, linear",
    "inserted.shadow.exr": "what it takes from the light, linear",
    "inserted.mask.exr": "its mask",
}


class Worker:
    """What can be asked for, and what is kept between requests."""

    def __init__(self, device: str):
        """Compute on `device`."""
        where = resolve_device(device)
        self._sessions, self._previews = (
            Sessions(where, most=1),
            CheckpointPreviews(where),
        )  # two need not be held

    def answer(self, task: dict[str, Any], tell: Tell) -> dict[str, Any]:
        """Return the result of a task; raise `LightprobeError` when it cannot be had."""
        folder, kind = Path(task["folder"]), TaskKind(task["task"])
        if kind is TaskKind.PREVIEW:
            return self._previews.write(Path(task["run"]), folder, tell)
        if kind is TaskKind.CORRECT:
            return _correct(task, tell)
        if kind is TaskKind.LOAD:
            return _load(self._sessions, task)
        told = (_predict if kind is TaskKind.PREDICT else _insert)(self._sessions, task, folder, tell)
        files = [
            {"name": name, "title": words} for name, words in _TITLES.items() if (folder / name).is_file()
        ]
        return {**told, "files": files}


def _correct(task: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """Take up what a person clicked on, painted or takes back in the mask of `photo` of a `scene`."""
    scene = Path(task["scene"])
    tell("reading what is known of the scene")
    if task["at"] is not None:
        click_mask(scene, task["photo"], tuple(task["at"]), task["object"], tell)
    elif task["forget"]:
        forget_correction(scene, task["photo"], tell)
    else:
        correct_masks(scene, tell)
    return {}


def _load(sessions: Sessions, task: dict[str, Any]) -> dict[str, Any]:
    """Load what the first photo of a run would wait for."""
    sessions.get(task["run"]).warm_up()
    return {}


def _predict(sessions: Sessions, task: dict[str, Any], folder: Path, tell: Tell) -> dict[str, Any]:
    """Predict the light in a photo; raise `InputError` for a photo without the object and one that no light explains."""
    upload = Path(task["upload"])
    tell("loading the object")
    session = sessions.get(task["run"])
    request = PredictRequest(photo=upload, name=task["name"])
    answer = predict_photo(session, request, AnswerFiles.within(folder, Output), tell)
    tell("drawing")
    camera, light = answer.facts.camera, answer.prediction.environment
    write_picture(
        folder / "render.png", *relight(session.predictor.decomposition, light, camera.within(SIDE))
    )
    write_bytes(folder / "photo.jpg", jpeg(read_ldr(upload)[0]))
    _draw(answer, folder)
    told, known = answer.to_json(), answer.light
    return {
        **told,
        "verdict": told["verdict"]["status"],
        "pose": None if told["pose"] is None else told["pose"]["status"],
        "sentences": answer.sentences,
        "camera": known["photo"]["camera"],
        "confidence": known["confidence"]["mean"],
        "sources": known["sources"],
    }


def _draw(answer: Answer, folder: Path) -> None:
    """Write the confidence and three balls under the light as the page shows them."""
    prediction, axes = answer.prediction, torch.from_numpy(answer.facts.camera.camera_to_world[:3, :3].copy())
    write_png(folder / "confidence.png", confidence_colors(plane(prediction.confidence)), srgb=False)
    map = torch.from_numpy(prediction.environment.panorama())
    balls = ThreeSpheres(axes[:, 2], axes[:, 1]).picture(map, _BALL).clamp(0, 1).numpy()
    disc = np.hypot(*np.meshgrid(*[(np.arange(_BALL) + 0.5) * 2 / _BALL - 1] * 2)) < 1
    write_png(folder / "balls.png", balls, np.tile(disc, 3).astype(np.float32), srgb=False)


def _insert(sessions: Sessions, task: dict[str, Any], folder: Path, tell: Tell) -> dict[str, Any]:
    """Put a GLB into the file `photo`, whose light the folder `prediction` holds.

    Raises `InputError` for a GLB that cannot be used, `ConfigError` for a place that cannot be.
    """
    prediction, image = Path(task["prediction"]), Path(task["photo"])
    tell("loading the object")
    session = sessions.get(task["run"])
    given, light = (
        load_virtual_object(Path(task["upload"])),
        Environment.load(prediction / _MAP, session.device),
    )
    camera = Camera.from_json(read_json(prediction / "camera.json"), source="this photo's camera")
    photo = PhotoView(read_ldr(image)[0], read_mask(prediction / "mask.png"), camera, is_opaque(image))
    at = None if task["at"] is None else (task["at"][0] * camera.width, task["at"][1] * camera.height)
    tell("putting it into the photo")
    placement = Placement(at, task["scale"], task["turn"])
    made = insert(session.predictor.decomposition, light, photo, given, placement)
    made.write(LayerFiles.of(folder / _INSERTED))
    return {
        "picture": _INSERTED,
        "at": [made.at[0] / camera.width, made.at[1] / camera.height],
        "scale": made.scale,
        "sentences": [*doubt_about_up(session.run), *made.warnings],
    }


def reworded(task: dict[str, Any], sentence: str) -> str:
    """Return a sentence in which the file that came in is called as the person knows it."""
    upload = task.get("upload")
    return sentence if upload is None else renamed(sentence, {Path(upload): task.get("name", "")})


if __name__ == "__main__":
    answer_requests(Worker(sys.argv[1]).answer, reworded)

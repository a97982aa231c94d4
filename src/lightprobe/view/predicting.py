"""The light in a photo for the page: camera, mask, map, confidence, balls and the object under the light, as
files.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from lightprobe.core.files import atomic_path
from lightprobe.evaluation import relight
from lightprobe.evaluation.three_spheres import ThreeSpheres
from lightprobe.export import write_picture
from lightprobe.imaging import read_ldr, shrink_area, srgb_encode, write_png
from lightprobe.jobs import Answer, AnswerFiles, Output, PredictRequest, Sessions, predict_photo
from lightprobe.light.display import exposure, tone_mapped
from lightprobe.light.files import plane
from lightprobe.prediction.color_scale import confidence_colors

MAP = "light.exr"
_OUTPUTS = tuple(output for output in Output if output is not Output.PNG)  # the page has pictures of its own
SIDE = 1024  # pixels of the longer side of a picture for the page
_MAP_ROWS = 256  # of the pictures of maps
_BALL = 192  # pixels across a ball

_TITLES = {
    "photo.jpg": "photo",
    "overlay.png": "the object's outline in the photo",
    "mask.png": "mask",
    "camera.json": "camera",
    MAP: "environment map, OpenEXR",
    "light.hdr": "environment map, Radiance HDR",
    "light.light.json": "the light in numbers: lamps, harmonics, exposure",
    "light.png": "environment map, picture",
    "confidence.exr": "confidence, OpenEXR",
    "confidence.png": "confidence, picture",
    "balls.png": "diffuse, matte and mirror ball",
    "render.png": "the object under this light",
}


def load(models: Sessions, request: dict[str, Any]) -> dict[str, Any]:
    """Load the predictor of a run and what new photos are located by, so that the first photo need not wait
    for it.
    """
    session = models.get(request["run"])
    if session.run.views_file.is_file():
        session.locator  # noqa: B018  loaded
    return {}


def predict(models: Sessions, request: dict[str, Any], tell: Callable[[str], None]) -> dict[str, Any]:
    """Predict the light in the file `upload` of a request with the run `run`, and write all files into
    `folder`.

    Returns what the page is told. Raises `InputError` for a photo without the object and one that no light
    explains.
    """
    folder, upload = Path(request["folder"]), Path(request["upload"])
    tell("loading the object")
    session = models.get(request["run"])
    wanted = PredictRequest(photo=upload, name=request["name"])
    answer = predict_photo(session, wanted, AnswerFiles.within(folder, _OUTPUTS), tell)
    tell("drawing")
    _draw(answer, folder)
    camera, light = answer.facts.camera, answer.prediction.environment
    picture = relight(session.predictor.decomposition, light, camera.within(SIDE))
    write_picture(folder / "render.png", *picture)
    _write_photo(folder / "photo.jpg", read_ldr(upload)[0])
    return _told(answer, folder)


def _draw(answer: Answer, folder: Path) -> None:
    """Write the map, its confidence and three balls under it as the page shows them."""
    prediction, camera = answer.prediction, answer.facts.camera
    image = prediction.environment.panorama()
    write_png(folder / "light.png", _enlarged(srgb_encode(tone_mapped(image, exposure(image)))), srgb=False)
    trust = confidence_colors(plane(prediction.confidence))
    write_png(folder / "confidence.png", _enlarged(trust), srgb=False)
    back, up = (torch.from_numpy(camera.camera_to_world[:3, axis].copy()) for axis in (2, 1))
    balls = ThreeSpheres(back, up).picture(torch.from_numpy(image), _BALL)
    disc = np.hypot(*np.meshgrid(*[(np.arange(_BALL) + 0.5) * 2 / _BALL - 1] * 2)) < 1
    write_png(
        folder / "balls.png", balls.clamp(0, 1).numpy(), np.tile(disc, 3).astype(np.float32), srgb=False
    )


def _enlarged(encoded: np.ndarray) -> np.ndarray:
    """Return a picture (h, w, 3) in [0, 1] with texels repeated up to 256 rows, so that a browser need not
    blur it.
    """
    factor = max(_MAP_ROWS // encoded.shape[0], 1)
    return np.clip(encoded, 0, 1).repeat(factor, 0).repeat(factor, 1)


def _write_photo(path: Path, color: np.ndarray) -> None:
    encoded = srgb_encode(np.clip(shrink_area(color, SIDE), 0, 1))
    with atomic_path(path) as temporary:
        Image.fromarray(np.rint(255 * encoded).astype(np.uint8)).save(temporary, format="JPEG", quality=90)


def _told(answer: Answer, folder: Path) -> dict[str, Any]:
    """Return what the page is told of a prediction."""
    told, light = answer.to_json(), answer.light
    return {
        **told,
        "files": [
            {"name": name, "title": title} for name, title in _TITLES.items() if (folder / name).is_file()
        ],
        "verdict": told["verdict"]["status"],
        "pose": None if told["pose"] is None else told["pose"]["status"],
        "sentences": answer.sentences,
        "camera": light["photo"]["camera"],
        "confidence": light["confidence"]["mean"],
        "sources": light["sources"],
    }

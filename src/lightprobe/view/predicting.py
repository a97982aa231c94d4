"""The light in a photo for the page: camera, mask, map, confidence, balls and the object under the light, as
files.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from lightprobe.core.config.prediction import Sun
from lightprobe.core.files import atomic_path, write_json
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import relight
from lightprobe.evaluation.three_spheres import ThreeSpheres
from lightprobe.export import write_picture
from lightprobe.export.light_file import PhotoFacts, write_light_file
from lightprobe.imaging import read_ldr, shrink_area, srgb_encode, write_mask, write_png
from lightprobe.light import cubemap
from lightprobe.light.display import exposure, tone_mapped
from lightprobe.light.files import plane
from lightprobe.localization.locator import write_overlay
from lightprobe.prediction import Prediction
from lightprobe.prediction.confidence import confidence_colors
from lightprobe.runs.loaded import LoadedRuns
from lightprobe.runs.locations import LocationFiles
from lightprobe.runs.new_photos import NewPhoto, PhotoFiles
from lightprobe.scene.camera import Camera

MAP, _RADIANCE = "light.exr", "light.hdr"
SIDE = 1024  # pixels of the longer side of a picture for the page
_MAP_ROWS = 256  # of the pictures of maps
_BALL = 192  # pixels across a ball

_TITLES = {
    "photo.jpg": "photo",
    "overlay.png": "the object's outline in the photo",
    "mask.png": "mask",
    "camera.json": "camera",
    MAP: "environment map, OpenEXR",
    _RADIANCE: "environment map, Radiance HDR",
    "light.light.json": "the light in numbers: lamps, harmonics, exposure",
    "light.png": "environment map, picture",
    "confidence.exr": "confidence, OpenEXR",
    "confidence.png": "confidence, picture",
    "balls.png": "diffuse, matte and mirror ball",
    "render.png": "the object under this light",
}


def load(models: LoadedRuns, request: dict[str, Any]) -> dict[str, Any]:
    """Load the predictor of a run and what new photos are located by, so that the first photo need not wait
    for it.
    """
    loaded = models.get(RunFolder.open(Path(request["run"])))
    if loaded.run.views_file.is_file():
        loaded.locator()
    return {}


def predict(models: LoadedRuns, request: dict[str, Any], tell: Callable[[str], None]) -> dict[str, Any]:
    """Predict the light in the file `upload` of a request with the run `run`, and write all files into
    `folder`.

    Returns what the page is told. Raises `InputError` for a photo without the object and one that no light
    explains.
    """
    begin = time.perf_counter()
    run, upload, folder = (
        RunFolder.open(Path(request["run"])),
        Path(request["upload"]),
        Path(request["folder"]),
    )
    tell("loading the object")
    loaded = models.get(run)
    predictor = loaded.predictor
    files = LocationFiles(folder / "camera.json", folder / "mask.png", folder / "overlay.png")
    photo = loaded.read(PhotoFiles(upload, None, files), tell=tell)
    tell("predicting the light")
    prediction = predictor.predict(
        photo.pixels, photo.pixel_camera, background=photo.background, doubt=photo.doubt, sources=True
    )
    tell("drawing")
    color = read_ldr(upload)[0]
    _write_maps(prediction, photo.camera, folder)
    facts = PhotoFacts(request["name"], photo.camera, photo.ev100)
    write_light_file(folder / MAP, prediction, facts, Sun.INSIDE, copies=[_RADIANCE])
    small = photo.camera.within(SIDE)
    write_picture(folder / "render.png", *relight(predictor.decomposition, prediction.environment, small))
    _write_photo(folder / "photo.jpg", color)
    if photo.location is None:
        write_json(folder / "camera.json", photo.camera.to_json())
        write_mask(folder / "mask.png", photo.pixels.alpha)
        write_overlay(folder / "overlay.png", color, photo.pixels.alpha)
    return _told(photo, prediction, folder, time.perf_counter() - begin)


def _write_maps(prediction: Prediction, camera: Camera, folder: Path) -> None:
    prediction.save(folder / MAP, confidence=folder / "confidence.exr")
    prediction.environment.save(folder / _RADIANCE)
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


def _told(photo: NewPhoto, prediction: Prediction, folder: Path, seconds: float) -> dict[str, Any]:
    """Return what the page is told of a prediction."""
    sentences = list(prediction.verdict.sentences)
    pose = None
    if photo.location is not None:
        pose = photo.location.located.verdict.status.value
        sentences = [*photo.location.located.verdict.sentences, *sentences]
    sources = [] if prediction.split is None else [source.to_json() for source in prediction.split.sources]
    files = [{"name": name, "title": title} for name, title in _TITLES.items() if (folder / name).is_file()]
    return {
        "files": files,
        "verdict": prediction.verdict.status.value,
        "pose": pose,
        "sentences": sentences,
        "seconds": {**prediction.seconds, "all": seconds},
        "camera": photo.camera.to_json(),
        "confidence": float(cubemap.sphere_mean(prediction.confidence)),
        "background": prediction.background.value,
        "sources": sources,
    }

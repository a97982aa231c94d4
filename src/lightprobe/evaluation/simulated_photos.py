"""Photos of a reconstructed object, rendered under known lights: how well the object tells of its light.

    a training camera, a generated light -> the object with errors of the usual size, exposure, noise, clipping,
      8 bits -> the predictor -> the map against the light, the spheres, and the error the confidence expected

Every object gets the same lights, none of which a training has seen, so that its numbers compare it with
others. What is wrong with this one object in particular they do not see: that is `models.object_verdict`'s
part.
"""

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.config.prediction import Method, PredictConfig
from lightprobe.core.device import generator
from lightprobe.core.errors import InputError
from lightprobe.evaluation.metrics import aligned, log_difference
from lightprobe.evaluation.three_spheres import SPHERES
from lightprobe.evaluation.true_light import TrueLight
from lightprobe.lessons.draw import Draw, upright
from lightprobe.lessons.generated_lights import generated_light
from lightprobe.lessons.synthetic import rerender
from lightprobe.light.cubemap import sphere_mean
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition, ProbeModel
from lightprobe.models.light_accuracy import LightAccuracy
from lightprobe.prediction import Prediction, Predictor, is_fitted, methods_for
from lightprobe.render.asset import rasterize_asset
from lightprobe.scene.camera import Camera, up_of
from lightprobe.scene.photo import Pixels

_SEED = 847_210_559  # of lights and photos; no training has the same by chance
_LARGEST_SIDE = 320  # pixels: what is predicted from larger photos is hardly better
_LARGEST_MAP = 32  # texels along a cubemap edge: maps of the paper's 128 take minutes


@dataclass(frozen=True)
class SimulatedPhoto:
    """A photo of the object, and the light that belongs to it."""

    pixels: Pixels
    camera: Camera  # input frame
    light: Tensor  # (6, R, R, 3) linear radiance in the photo's exposure


def simulated_photos(
    decomposition: Decomposition, cameras: Sequence[Camera], count: int, resolution: int, device: torch.device
) -> Iterator[SimulatedPhoto | None]:
    """Yield `count` photos from some input-frame `cameras` under lights (6, R, R, 3) of `resolution` R.

    None stands for a photo that would not show the object.
    """
    up = torch.from_numpy(up_of(cameras)).float()
    for number in range(count):
        camera = cameras[number * len(cameras) // count].within(_LARGEST_SIDE)
        # Turned with the camera, every light comes from where it comes from in the photo of any other object.
        turn = _azimuth(camera, up)
        fixed: dict[str, Any] = {"seed": _SEED, "up": up, "tumbled": 0.0, "device": device}
        light = generated_light(resolution, step=number, turn=turn, **fixed)
        yield _photo(decomposition, camera, light, Draw(generator(_SEED, "simulated-photo", number)))


@torch.no_grad()
def _photo(decomposition: Decomposition, camera: Camera, light: Tensor, draw: Draw) -> SimulatedPhoto | None:
    gbuffer = rasterize_asset(decomposition.asset, camera.normalised(decomposition.similarity), light.device)
    if len(gbuffer.pixel) == 0:
        return None
    color, factor = rerender(gbuffer, light, draw)
    shape, at = (camera.height, camera.width), gbuffer.pixel.cpu().numpy()
    image, alpha = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32)
    image.reshape(-1, 3)[at], alpha.reshape(-1)[at] = color.cpu().numpy(), 1
    pixels = Pixels.of(image, alpha)
    return SimulatedPhoto(pixels, camera, light * factor)


def _azimuth(camera: Camera, up: Tensor) -> float:
    """Return the angle in radians about `up` (3,) that the camera stands at."""
    back = upright(up, 0.0) @ torch.from_numpy(camera.camera_to_world[:3, 2]).float()
    return math.atan2(float(back[1]), float(back[0]))


def directional_error(found: Tensor, light: Tensor) -> Tensor:
    """Return the error of ln radiance (6, R, R), over channels, of a map (6, R, R, 3) scaled to fit best."""
    return aligned(log_difference(found, light)).square().mean(-1).sqrt()


def light_accuracy(
    decomposition: Decomposition,
    model: ProbeModel,
    cameras: Sequence[Camera],
    config: PredictConfig,
    device: torch.device,
    seed: int,
    on_photo: Callable[[int, int], None] | None = None,
    *,
    count: int,
) -> LightAccuracy | None:
    """Return how good the maps predicted for `count` simulated photos are; None where none shows the object.

    cameras: input-frame ones of the training photos. config: how the run predicts. on_photo: hears of (done,
    all).
    """
    config = replace(config, light_resolution=min(config.light_resolution, _LARGEST_MAP))
    plain = replace(decomposition, verdict=None)  # whose doubt the confidence adds by itself
    predictor = Predictor(plain, model, device, config=config, seed=seed)
    methods, default = methods_for(model), methods_for(model, config)[0]
    fitted, estimated = (next(m for m in methods if is_fitted(m) is kind) for kind in (True, False))
    shown = fitted if default is Method.OPTIMIZE else default
    found: dict[Method, list[_Outcome]] = {method: [] for method in dict.fromkeys((shown, fitted, estimated))}
    photos = simulated_photos(decomposition, cameras, count, config.light_resolution, device)
    for done, photo in enumerate(photos, start=1):
        if photo is not None:
            for method, outcomes in found.items():
                with contextlib.suppress(InputError):  # too little of the object is in it
                    prediction = predictor.predict(photo.pixels, photo.camera, method, refuse=False)
                    outcomes.append(_Outcome.of(prediction, photo, decomposition.similarity.center))
        if on_photo is not None:
            on_photo(done, count)
    if not found[shown]:
        return None
    diffuse, matte, mirror = (_mean([outcome.spheres[name] for outcome in found[shown]]) for name in SPHERES)
    error, scales = (
        _mean([outcome.error for outcome in found[shown]]),
        (_scale(found[m]) for m in (fitted, estimated)),
    )
    return LightAccuracy(shown.value, len(found[shown]), error, (diffuse, matte, mirror), *scales)


@dataclass(frozen=True)
class _Outcome:
    """What a map came to; errors of ln radiance are means by solid angle."""

    error: float
    expected: float  # by the confidence, less what the photo's verdict adds
    spheres: dict[str, float]  # si-RMSE

    @staticmethod
    def of(prediction: Prediction, photo: SimulatedPhoto, center: np.ndarray) -> "_Outcome":
        error = directional_error(prediction.environment.texels, photo.light)
        expected = -prediction.confidence.log() - prediction.verdict.doubt
        scores = TrueLight.of(Environment(photo.light), photo.camera, center).scores(prediction)
        spheres = {name: scores[f"{name}_si_rmse"] for name in SPHERES}
        return _Outcome(float(sphere_mean(error)), float(sphere_mean(expected)), spheres)


def _scale(outcomes: Sequence[_Outcome]) -> float:
    """Return how many times as large as expected the errors are."""
    return sum(outcome.error for outcome in outcomes) / sum(outcome.expected for outcome in outcomes)


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)

"""Fits the weights of `prediction.confidence` to photos that the project makes of a run's object under its own lights.

    python tools/fit_confidence.py runs/demo [RUN ...] [--method probe-net+optimize] [--photos 64]

Each photo is what a training camera of the run would see of the object, with errors of the asset, noise, clipping and 8
bits (`lessons.synthetic.rerender`), under a generated light that no training has seen (`lessons.generated_lights`). The
light is predicted from it, and the error of ln radiance after one factor is explained, direction by direction, by non-
negative least squares on the causes that `error_causes` names. No light of a data set enters, neither for training nor
for evaluation; those check the confidence afterwards.

Prints the weights of all photos, and the errors in five bins of confidence: with the weights in use, and with those
fitted to the other half of the photos.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import nnls
from torch import Tensor

from lightprobe.core.device import generator
from lightprobe.core.errors import LightprobeError
from lightprobe.core.run import RunFolder
from lightprobe.evaluation.metrics import aligned, log_difference
from lightprobe.lessons.draw import Draw
from lightprobe.lessons.generated_lights import generated_light
from lightprobe.lessons.synthetic import rerender
from lightprobe.light import cubemap
from lightprobe.models import Decomposition
from lightprobe.prediction import Method, Predictor
from lightprobe.prediction.confidence import CAUSES, ESTIMATED, FITTED, Weights, error_causes
from lightprobe.prediction.observation import observe
from lightprobe.render.asset import rasterize_asset
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Camera, mean_up
from lightprobe.scene.photo import Pixels

SEED = 2026  # of lights and photos; trainings have other seeds
BINS = 5
_FITTED_TO_PIXELS = ("solve", "optimize")  # the last step of methods whose maps are fitted to the photo


@dataclass(frozen=True)
class Samples:
    """Causes and errors of N directions of all photos."""

    causes: np.ndarray  # (N, C + 1), the last column 1
    error: np.ndarray  # (N,) of ln radiance
    angle: np.ndarray  # (N,) solid angle
    photo: np.ndarray  # (N,) number of the photo

    def part(self, remainder: int) -> "Samples":
        """Return every second photo."""
        chosen = self.photo % 2 == remainder
        return Samples(self.causes[chosen], self.error[chosen], self.angle[chosen], self.photo[chosen])


@torch.no_grad()
def photograph(decomposition: Decomposition, camera: Camera, light: Tensor, number: int) -> tuple[Pixels, Tensor]:
    """Return photo `number` of the object by an input-frame camera, and the light (6, R, R, 3) that goes with it."""
    gbuffer = rasterize_asset(decomposition.asset, camera.normalised(decomposition.similarity), light.device)
    color, factor = rerender(gbuffer, light, Draw(generator(SEED, "confidence-photo", number)))
    image, alpha = np.zeros((camera.height * camera.width, 3), np.float32), np.zeros(camera.height * camera.width)
    image[gbuffer.pixel.numpy()], alpha[gbuffer.pixel.numpy()] = color.numpy(), 1
    shape = (camera.height, camera.width)
    return Pixels.of(image.reshape(*shape, 3), alpha.reshape(shape).astype(np.float32)), light * factor


def samples(predictor: Predictor, cameras: Sequence[Camera], method: Method, photos: int) -> Samples:
    """Return what `photos` photos of the predictor's object say, its `cameras` taken in turn."""
    resolution, asset = predictor.config.light_resolution, predictor.decomposition.asset
    up = torch.from_numpy(mean_up([camera.camera_to_world[:3, 1] for camera in cameras])).float()
    rows, errors = [], []
    for number in range(photos):
        camera = cameras[number % len(cameras)]
        light = generated_light(resolution, seed=SEED, step=number, up=up)
        pixels, truth = photograph(predictor.decomposition, camera, light, number)
        found = predictor.predict(pixels, camera, method).environment.texels
        view = camera.normalised(predictor.decomposition.similarity)
        observation = observe(asset, pixels, view, predictor.device, predictor.config.max_pixels)
        causes = error_causes(observation, found, predictor.seed)
        rows.append(torch.stack([*(causes[name] for name in CAUSES), torch.ones_like(found[..., 0])], -1))
        errors.append(aligned(log_difference(found, truth)).square().mean(-1).sqrt())
    every = 6 * resolution**2
    angle = np.tile(cubemap.solid_angles(resolution).reshape(-1).double().numpy(), photos)
    explained = torch.stack(rows).double().numpy().reshape(-1, len(CAUSES) + 1)
    return Samples(explained, torch.stack(errors).double().numpy().ravel(), angle, np.arange(photos).repeat(every))


def fit(found: Samples) -> np.ndarray:
    """Return the weights (C + 1,) >= 0, by solid angle."""
    share = np.sqrt(found.angle)
    weights: np.ndarray = nnls(found.causes * share[:, None], found.error * share)[0]
    return weights


def binned(found: Samples, weights: np.ndarray) -> np.ndarray:
    """Return the log-RMSE (5,) in bins of equal solid angle, the least confident first."""
    order = np.argsort(-(found.causes @ weights), kind="stable")
    place = np.cumsum(found.angle[order]) - found.angle[order] / 2
    part = (BINS * place / found.angle.sum()).astype(int)
    square, share = found.error[order] ** 2, found.angle[order]
    return np.sqrt([np.average(square[part == i], weights=share[part == i]) for i in range(BINS)])


def gap(found: Samples, weights: np.ndarray) -> float:
    """Return the root mean square, by solid angle, of the expected error less the true one."""
    return float(np.sqrt(np.average((found.causes @ weights - found.error) ** 2, weights=found.angle)))


def report(found: Samples, used: Weights) -> list[str]:
    """Return the lines to print: fitted weights, and how both sort the errors of photos they were not fitted to."""
    named = ", ".join(f"{name}={value:.2f}" for name, value in zip((*CAUSES, "least"), fit(found), strict=True))
    lines = [f"fitted  Weights({named})", f"in use  {used}"]
    now = np.array([getattr(used, name) for name in (*CAUSES, "least")])
    for remainder in (0, 1):
        half, fitted = found.part(remainder), fit(found.part(1 - remainder))
        for name, weights in (("in use", now), ("fitted to the other half", fitted)):
            bins = " ".join(f"{value:.2f}" for value in binned(half, weights))
            lines.append(f"half {remainder + 1}, weights {name}: log-RMSE {bins}, off by {gap(half, weights):.3f}")
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line and print the weights and the check for each run."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("runs", type=Path, nargs="+", help="finished runs, whose scenes lie where they were")
    parser.add_argument("--method", type=Method, default=Method.PROBE_NET_OPTIMIZE)
    parser.add_argument("--photos", type=int, default=64, help="of each run's object, at least 2")
    given = parser.parse_args(arguments)
    used = FITTED if given.method.value.endswith(_FITTED_TO_PIXELS) else ESTIMATED
    try:
        for path in given.runs:
            scene = load_scene(Path(RunFolder.open(path).scene()["root"]))
            cameras = [photo.camera for photo in scene.train]
            found = samples(Predictor.load(path), cameras, given.method, max(given.photos, 2))
            print(path, *report(found, used), sep="\n", flush=True)
    except LightprobeError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()

"""Fits the weights of `prediction.confidence` to photos that the project makes of a run's object under its
own lights.

    python tools/fit_confidence.py runs/demo [RUN ...] [--method probe-net+optimize] [--photos 64]

The photos are those of `evaluation.simulated_photos`, under generated lights that no training has seen. The
light is predicted from each, and the error of ln radiance after one factor is explained, direction by
direction, by non-negative least squares on the causes that `error_causes` names. No light of a data set
enters, neither for training nor for evaluation; those check the confidence afterwards.

Prints the weights of each run, and of several the weights of all together, each counting the same, which stand in
`prediction.confidence`; behind each the root mean square of the expected less the true error of photos that were not
fitted to, and the same with the weights in use.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import nnls

from lightprobe.core.errors import InputError, LightprobeError
from lightprobe.core.run import RunFolder
from lightprobe.evaluation.simulated_photos import directional_error, simulated_photos
from lightprobe.light import cubemap
from lightprobe.models import Decomposition, ProbeModel
from lightprobe.prediction import Method, Predictor, is_fitted, recorded_config
from lightprobe.prediction.confidence import CAUSES, ESTIMATED, FITTED, Weights, error_causes
from lightprobe.prediction.observation import observe
from lightprobe.scene.camera import Camera
from lightprobe.scene.record import read_record


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


def samples(predictor: Predictor, cameras: Sequence[Camera], method: Method, photos: int) -> Samples:
    """Return what `photos` photos of the predictor's object say, from input-frame `cameras`."""
    resolution, decomposition = predictor.config.light_resolution, predictor.decomposition
    rows, errors = [], []
    for photo in simulated_photos(decomposition, cameras, photos, resolution, predictor.device):
        if photo is None:
            continue
        try:
            found = predictor.predict(photo.pixels, photo.camera, method, refuse=False).environment.texels
        except InputError:  # too little of the object is in it
            continue
        view = photo.camera.normalised(decomposition.similarity)
        observation = observe(
            decomposition.asset, photo.pixels, view, predictor.device, predictor.config.max_pixels
        )
        causes = error_causes(observation, found, predictor.seed)
        rows.append(torch.stack([*(causes[name] for name in CAUSES), torch.ones_like(found[..., 0])], -1))
        errors.append(directional_error(found, photo.light))
    if not rows:
        raise InputError("None of the simulated photos shows the object; look at the run's cameras.")
    every = 6 * resolution**2
    angle = np.tile(cubemap.solid_angles(resolution).reshape(-1).double().numpy(), len(rows))
    explained = torch.stack(rows).double().numpy().reshape(-1, len(CAUSES) + 1)
    return Samples(
        explained, torch.stack(errors).double().numpy().ravel(), angle, np.arange(len(rows)).repeat(every)
    )


def fit(found: Samples) -> np.ndarray:
    """Return the weights (C + 1,) >= 0, by solid angle."""
    share = np.sqrt(found.angle)
    weights: np.ndarray = nnls(found.causes * share[:, None], found.error * share)[0]
    return weights


def joined(found: Sequence[Samples]) -> Samples:
    """Return the samples of all objects as one, each object weighing the same."""
    parts = [(s.causes, s.error, s.angle / s.angle.sum(), s.photo) for s in found]
    return Samples(*map(np.concatenate, zip(*parts, strict=True)))


def gap(found: Samples, weights: np.ndarray) -> float:
    """Return the root mean square, by solid angle, of the expected error less the true one."""
    return float(np.sqrt(np.average((found.causes @ weights - found.error) ** 2, weights=found.angle)))


def named(weights: np.ndarray) -> str:
    """Return weights (C + 1,) as they stand in `prediction.confidence`."""
    pairs = zip((*CAUSES, "least"), weights, strict=True)
    return f"Weights({', '.join(f'{name}={value:.2f}' for name, value in pairs)})"


def report(found: Samples, used: Weights) -> str:
    """Return the line to print of an object."""
    halves = [gap(found.part(other), fit(found.part(1 - other))) for other in (0, 1)]
    now = gap(found, np.array([getattr(used, name) for name in (*CAUSES, "least")]))
    return f"{named(fit(found))}, off by {sum(halves) / 2:.3f}; in use: off by {now:.3f}"


def _predictor(run: RunFolder) -> Predictor:
    """Return the predictor of a run in its own gauge, in which the simulated photos are."""
    cpu = torch.device("cpu")
    model = ProbeModel.load(run.model_folder) if ProbeModel.exists(run.model_folder) else None
    return Predictor(Decomposition.load(run, cpu, calibrated=False), model, config=recorded_config(run))


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line and print the weights and the check for each run."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("runs", type=Path, nargs="+", help="finished runs, whose scenes lie where they were")
    parser.add_argument("--method", type=Method, default=Method.PROBE_NET_OPTIMIZE)
    parser.add_argument("--photos", type=int, default=64, help="of each run's object, at least 2")
    given = parser.parse_args(arguments)
    used = FITTED if is_fitted(given.method) else ESTIMATED
    every: list[Samples] = []
    try:
        for path in given.runs:
            run = RunFolder.open(path)
            cameras = list(read_record(run).cameras["train"].values())
            every.append(samples(_predictor(run), cameras, given.method, max(given.photos, 2)))
            print(path, report(every[-1], used), flush=True)
    except LightprobeError as error:
        sys.exit(str(error))
    if len(every) > 1:
        print(f"all together  {named(fit(joined(every)))}")


if __name__ == "__main__":
    main()

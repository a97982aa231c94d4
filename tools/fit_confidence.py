"""Fits the weights of `predict.confidence` to runs on scenes whose training photos have known lights.

    python tools/fit_confidence.py runs/chair runs/spot runs/bottle --method probe-net+optimize

For every n-th training photo of every run the light is predicted, and the error of ln radiance after one factor is
explained, direction by direction, by non-negative least squares on the causes that `error_causes` names. Prints the
weights of all runs together, and for each run the errors in five bins of confidence under the weights of the others.
Test photos are left alone: the evaluation checks the confidence on them.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import nnls

from lightprobe.core.run import RunFolder
from lightprobe.decompose import Decomposition
from lightprobe.distill import ProbeModel
from lightprobe.evaluate import load_environment
from lightprobe.evaluate.metrics import aligned, log_difference
from lightprobe.light import cubemap
from lightprobe.predict import Method, Predictor
from lightprobe.predict.confidence import CAUSES, error_causes
from lightprobe.predict.observation import observe
from lightprobe.scene import load_pixels, load_scene

CPU = torch.device("cpu")


def samples(path: Path, method: Method, every: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return causes (N, C + 1), the last column 1, errors (N,) and solid angles (N,), over directions and photos."""
    run = RunFolder.open(path)
    decomposition, scene = Decomposition.load(run, CPU), load_scene(Path(run.scene()["root"]))
    model = ProbeModel.load(run.model_folder) if (run.model_folder / "config.json").exists() else None
    predictor = Predictor(decomposition, model)
    rows, errors, angles = [], [], []
    for photo in scene.train[::every]:
        if photo.truth.environment is None:
            continue
        pixels, camera = load_pixels(photo)
        light = predictor.predict(pixels, camera, method).environment
        camera = camera.normalised(decomposition.similarity)
        observation = observe(predictor.asset, pixels, camera, CPU, predictor.config.max_pixels)
        causes = error_causes(observation, light, predictor.seed)
        difference = aligned(log_difference(light, load_environment(photo.truth.environment, CPU, light.shape[1])))
        rows.append(torch.stack([*(causes[name] for name in CAUSES), torch.ones_like(light[..., 0])], -1))
        errors.append(difference.square().mean(-1).sqrt())
        angles.append(cubemap.solid_angles(light.shape[1]))
    if not rows:
        raise SystemExit(f"{path}: no training photo has a known light")
    causes, error, angle = (torch.stack(parts).double().numpy() for parts in (rows, errors, angles))
    return causes.reshape(-1, len(CAUSES) + 1), error.reshape(-1), angle.reshape(-1)


def fit(parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return the weights (C + 1,) >= 0 of all samples together, by solid angle."""
    causes, error, angle = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    share = np.sqrt(angle)
    return nnls(causes * share[:, None], error * share)[0]


def binned(causes: np.ndarray, error: np.ndarray, angle: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the log-RMSE (5,) in bins of equal solid angle, the least confident first."""
    order = np.argsort(-(causes @ weights), kind="stable")
    place = np.cumsum(angle[order]) - angle[order] / 2
    part = (5 * place / angle.sum()).astype(int)
    square, share = error[order] ** 2, angle[order]
    return np.sqrt([np.average(square[part == i], weights=share[part == i]) for i in range(5)])


def main() -> None:
    """Read the command line and print the weights and the check."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--method", type=Method, default=Method.PROBE_NET_OPTIMIZE)
    parser.add_argument("--every", type=int, default=8, help="use every n-th training photo")
    given = parser.parse_args()
    parts = [samples(path, given.method, given.every) for path in given.runs]
    named = [f"{name}={value:.2f}" for name, value in zip((*CAUSES, "least"), fit(parts), strict=True)]
    print(f"Weights({', '.join(named)})")
    for i, path in enumerate(given.runs):
        others = fit(parts[:i] + parts[i + 1 :] or parts)
        print(f"{path}, weights of the others: {np.round(binned(*parts[i], others), 2)}")


if __name__ == "__main__":
    main()

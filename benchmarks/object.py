"""Run Phase I alone on scenes that bring their truth, and score the object and the lights: a table in Markdown.

    python -m benchmarks object DATA/synthetic/vase DATA/synthetic/bottle [--set light_chroma=0 metallic_prior=.01]

For choices about materials and lights: it takes a third of a whole training, and nothing of Phase II can hide or add an
error. --set changes fields of the preset's `DecomposeConfig`. The lights are those of the training photos, compared
with the true ones on 6 x 8 x 8 texels after one factor per channel: log-RMSE, and of that the part in which channels
differ (cast). The spheres' errors (`evaluation.three_spheres`) are of lights that are read off the test photos by least
squares. The last columns are what the object's verdict rests on (`models.object_verdict`).
"""

import time
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks import command_line
from lightprobe.core.config import DecomposeConfig, Method, Preset, settings
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError
from lightprobe.evaluation.three_spheres import SPHERES
from lightprobe.evaluation.true_light import TrueLight
from lightprobe.evaluation.truth import MaterialScores, relight_scores
from lightprobe.evaluation.views import TestView
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.prediction import Predictor
from lightprobe.reconstruction import decompose
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.photo import Scene

_SIDE = 8  # texels along an edge of the cubemaps that are compared
_FLOOR = 0.05  # of a map's mean radiance: what is darker counts as this
_COLUMNS = {
    "seconds": ".0f",
    "base_color_psnr": ".1f",
    "base_color_psnr_scaled": ".1f",
    "base_color_ratio": ".2f",
    "roughness_mae": ".3f",
    "metallic_mae": ".3f",
    "normal_degrees": ".1f",
    "relight_psnr": ".1f",
    "relight_psnr_scaled": ".1f",
    "light_log_rmse": ".2f",
    "light_cast": ".2f",
    "diffuse": ".3f",
    "matte": ".3f",
    "mirror": ".3f",
    "disagreement": ".4f",
    "front_bias": ".2f",
    "surprise": ".1f",
}


def changed(config: DecomposeConfig, changes: Sequence[str]) -> DecomposeConfig:
    """Return the configuration with NAME=VALUE in place; raise `ConfigError` for what is no number of it."""
    kinds: dict[str, Any] = {field.name: type(getattr(config, field.name)) for field in fields(config)}
    for change in changes:
        name, _, value = change.partition("=")
        if name not in kinds or kinds[name] not in (int, float):
            raise ConfigError(f"--set {change} names no number of DecomposeConfig.")
        try:
            config = replace(config, **{name: kinds[name](value)})
        except ValueError as error:
            raise ConfigError(f"--set {change}: '{value}' is no {kinds[name].__name__}.") from error
    return config


def light_errors(light: Tensor, truth: Tensor) -> tuple[float, float]:
    """Return the log-RMSE of a light (6, R, R, 3) against the true one, and its cast, as the module says."""
    weight = cubemap.solid_angles(_SIDE)[..., None]
    weight = weight / (3 * weight.sum())
    logs = []
    for texels in (light, truth):
        coarse = Environment(texels).resized(_SIDE).texels
        logs.append((coarse / (3 * weight * coarse).sum((0, 1, 2)) + _FLOOR).log())
    difference = logs[0] - logs[1]
    cast = difference - difference.mean(-1, keepdim=True)
    return float((weight * difference.square()).sum()) ** 0.5, float((weight * cast.square()).sum()) ** 0.5


def light_scores(decomposition: Decomposition, scene: Scene) -> dict[str, float]:
    """Return the mean errors of the training photos' lights, {} for a scene without true ones."""
    errors = [
        light_errors(
            decomposition.lights[photo.name].texels.cpu(), Environment.load(photo.truth.environment).texels
        )
        for photo in scene.train
        if photo.truth.environment is not None
    ]
    if not errors:
        return {}
    total, cast = (sum(values) / len(errors) for values in zip(*errors, strict=True))
    return {"light_log_rmse": total, "light_cast": cast}


def read_lights(
    decomposition: Decomposition, scene: Scene, device: torch.device, method: Method = Method.SOLVE
) -> dict[str, float]:
    """Return the spheres' mean errors under lights read off the test photos, {} for photos without true ones."""
    predictor, found = Predictor(decomposition, None, device), []
    for photo in scene.test:
        if photo.truth.environment is not None:
            pixels, camera = load_pixels(photo)
            side, center = predictor.config.light_resolution, scene.similarity.center
            true = TrueLight.load(photo.truth.environment, camera, center, side, device)
            scores = true.scores(predictor.predict(pixels, camera, method, refuse=False))
            found.append([scores[f"{name}_si_rmse"] for name in SPHERES])
    return dict(zip(SPHERES, map(float, np.mean(found, axis=0)), strict=True)) if found else {}


def measure(folder: Path, config: DecomposeConfig, device: torch.device, seed: int) -> dict[str, float]:
    """Run Phase I on a scene and return its scores."""
    scene, start = load_scene(folder), time.monotonic()
    decomposition = decompose(scene, config, device, seed)
    seconds, materials = time.monotonic() - start, MaterialScores()
    for photo in scene.test:
        materials.add(TestView.load(photo, decomposition, config.teacher_resolution, device))
    verdict = decomposition.verdict
    judged = {} if verdict is None else dict(vars(verdict))
    lit = relight_scores(decomposition, scene, device) | light_scores(decomposition, scene)
    read = read_lights(decomposition, scene, device)
    return {"seconds": seconds, **materials.result(), **lit, **read, **judged}


def main(words: Sequence[str]) -> None:
    """Measure the scenes that the command line names."""
    parser = command_line(__doc__)
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--preset", type=Preset, default=Preset.QUICK, choices=list(Preset))
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(words)
    config = changed(settings(given.preset).decompose, given.set)
    print("| scene | " + " | ".join(_COLUMNS) + " |\n| --- |" + " ---: |" * len(_COLUMNS), flush=True)
    for folder in given.scenes:
        scores = measure(folder, config, resolve_device(given.device), given.seed)
        cells = [format(scores[name], form) if name in scores else "–" for name, form in _COLUMNS.items()]
        print(f"| {folder.name} | " + " | ".join(cells) + " |", flush=True)

"""The evaluation of a run: every test photo, every method, and the truth where there is one.

Protocol A: the light is predicted from the full test photo and the photo re-rendered with it. Protocol B: predicted
from one half of the object's pixels, scored on the other half only ("psnr_unseen"), mean over four such splits.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.errors import InputError
from lightprobe.core.run import RunFolder
from lightprobe.decompose import Decomposition
from lightprobe.distill import ProbeModel
from lightprobe.evaluate import truth
from lightprobe.evaluate.metrics import on_white
from lightprobe.evaluate.prediction_files import write_prediction
from lightprobe.evaluate.views import TestView, halves
from lightprobe.predict import Method, Prediction, Predictor
from lightprobe.scene.photo import Photo, Scene

OnPhoto = Callable[[int, int], None]  # (photos done, photos in all)
OnView = Callable[["ViewResult"], None]
Scores = dict[str, float]


@dataclass(frozen=True)
class ViewResult:
    """What the default method made of one test photo."""

    view: TestView
    prediction: Prediction
    image: Tensor  # (H, W, 3) sRGB on white: the re-rendered photo
    scores: Scores


@dataclass
class Evaluation:
    """All numbers: `photos[name][method]` and `truth`; means are taken by `to_json`."""

    default: Method
    photos: dict[str, dict[Method, Scores]] = field(default_factory=dict)
    truth: Scores = field(default_factory=dict)

    def mean(self, method: Method) -> Scores:
        """Return the mean over photos of every score that the method has."""
        each = [scores[method] for scores in self.photos.values()]
        names = dict.fromkeys(name for scores in each for name in scores)
        return {name: _mean([scores[name] for scores in each if name in scores]) for name in names}

    def to_json(self) -> dict[str, Any]:
        """Return the content of metrics.json; scores that could not be computed are left out."""
        methods = list(dict.fromkeys(method for scores in self.photos.values() for method in scores))
        photos = {
            name: {**_finite(scores[self.default]), "methods": {m.value: _finite(s) for m, s in scores.items()}}
            for name, scores in self.photos.items()
        }
        return {
            "mean": {**_finite(self.mean(self.default)), **_finite(self.truth)},
            "default_method": self.default.value,
            "methods": {method.value: _finite(self.mean(method)) for method in methods},
            "photos": photos,
        }


def evaluate(
    decomposition: Decomposition,
    model: ProbeModel | None,
    scene: Scene,
    *,
    methods: Sequence[Method],
    device: torch.device,
    run: RunFolder | None = None,
    unseen: bool = True,
    on_photo: OnPhoto | None = None,
    on_view: OnView | None = None,
) -> Evaluation:
    """Score `methods`, the first being the default, on the scene's test photos; `unseen` adds protocol B.

    With `run`, predictions are written to its folder. `on_view` receives the default method's result for every photo.
    Raises `InputError` when the scene has no test photo.
    """
    if not scene.test:
        raise InputError(f"{scene.root} has no test photos to evaluate on; add some, or use more than one photo.")
    decomposition = replace(decomposition, asset=decomposition.asset.to(device))
    predictor = Predictor.of(decomposition, model, device)
    result = Evaluation(methods[0])
    materials = truth.MaterialScores()
    for done, photo in enumerate(scene.test):
        view = TestView.load(photo, decomposition, device)
        materials.add(view)
        result.photos[photo.name] = {}
        for method in methods:
            seen = _protocol_a(view, predictor, decomposition, method)
            scores = {**seen.scores, **(_protocol_b(view, predictor, decomposition, method) if unseen else {})}
            result.photos[photo.name][method] = scores
            if run is not None:
                _write(seen.prediction, run, photo, method, default=method is methods[0])
            if on_view is not None and method is methods[0]:
                on_view(replace(seen, scores=scores))
        if on_photo is not None:
            on_photo(done + 1, len(scene.test))
    result.truth = materials.result() | truth.relight_scores(decomposition, scene, device)
    mesh_file = scene.root / "mesh.obj"
    if mesh_file.is_file():
        result.truth |= truth.surface_scores(decomposition, mesh_file)
    return result


def _protocol_a(view: TestView, predictor: Predictor, decomposition: Decomposition, method: Method) -> ViewResult:
    prediction = predictor.predict(view.pixels, view.camera, method)
    image = on_white(*view.render(decomposition, prediction.environment))
    scores = {**view.score(image).to_json(), "seconds": prediction.seconds["total"]}
    if view.photo.truth.environment is not None:
        scores |= truth.light_scores(prediction, view.photo.truth.environment)
    return ViewResult(view, prediction, image, scores)


def _protocol_b(view: TestView, predictor: Predictor, decomposition: Decomposition, method: Method) -> Scores:
    masks = halves(view.pixels.alpha)
    values = []
    for i, mask in enumerate(masks):
        half = replace(view.pixels, alpha=np.where(mask, view.pixels.alpha, np.float32(0)))
        light = predictor.predict(half, view.camera, method).environment
        image = on_white(*view.render(decomposition, light))
        other = torch.from_numpy(masks[i ^ 1]).to(image.device)
        values.append(view.score(image, other).psnr_masked)
    return {"psnr_unseen": _mean(values)}


def _write(prediction: Prediction, run: RunFolder, photo: Photo, method: Method, *, default: bool) -> None:
    write_prediction(prediction, run.prediction_file(photo.name, ".exr", method.value))
    if default:
        write_prediction(prediction, run.prediction_file(photo.name, ".exr"))


def _mean(values: list[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return sum(known) / len(known) if known else math.nan


def _finite(scores: Scores) -> Scores:
    return {name: value for name, value in scores.items() if math.isfinite(value)}

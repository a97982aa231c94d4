"""The evaluation of a run: every test photo, every method, and the truth where there is one.

Protocol A: the light is predicted from the full test photo and the photo re-rendered with it. Protocol B:
predicted from one half of the object's pixels, scored on the other half only ("psnr_unseen"), mean over four
such splits.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.config.prediction import Sun
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import truth
from lightprobe.evaluation.metrics import photo_interval
from lightprobe.evaluation.true_light import ConfidenceBins, StandIn, TrueLight, falls
from lightprobe.evaluation.views import TestView, halves
from lightprobe.imaging import write_png
from lightprobe.light.display import exposure, tone_mapped
from lightprobe.light.files import write_map
from lightprobe.models import Decomposition, LightAccuracy, ProbeModel
from lightprobe.prediction import (
    Method,
    PhotoStatus,
    PhotoVerdict,
    PredictConfig,
    Prediction,
    Predictor,
    methods_for,
)
from lightprobe.scene.photo import Photo, Scene

OnPhoto = Callable[[int, int], None]  # (photos done, photos in all)
OnView = Callable[["ViewResult"], None]
Scores = dict[str, float]


def write_prediction(
    prediction: Prediction, path: Path, height: int | None = None, sun: Sun = Sun.INSIDE
) -> None:
    """Write `path` (.exr or .hdr), a tone-mapped .png and .confidence.exr; arguments: `Prediction.save`."""
    image = prediction.map(sun).panorama(height)
    write_map(path, image)
    write_png(path.with_suffix(".png"), tone_mapped(image, exposure(image)))
    prediction.save_confidence(path.with_suffix(".confidence.exr"))


@dataclass(frozen=True)
class ViewResult:
    """What the default method made of one test photo."""

    view: TestView
    prediction: Prediction
    image: Tensor  # (H, W, 3) sRGB on white: the re-rendered photo
    scores: Scores
    true_light: TrueLight | None = None


@dataclass
class Evaluation:
    """All numbers: `photos[name][method]`, `truth` and the bins of confidence; `to_json` takes the means."""

    default: Method
    photos: dict[str, dict[Method, Scores]] = field(default_factory=dict)
    truth: Scores = field(default_factory=dict)
    confidence: dict[Method, list[Scores]] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)  # photo that could not be scored -> why
    verdicts: dict[str, PhotoVerdict] = field(default_factory=dict)  # of the photos that are scored
    lights: dict[str, str] = field(default_factory=dict)  # photo -> name of its light, where the scene tells

    def values(self, method: Method) -> dict[str, dict[str, float]]:
        """Return the finite values of every score of the method, by photo."""
        each = {photo: scores[method] for photo, scores in self.photos.items() if method in scores}
        names = dict.fromkeys(name for scores in each.values() for name in scores)
        return {
            name: {photo: s[name] for photo, s in each.items() if name in s and math.isfinite(s[name])}
            for name in names
        }

    def mean(self, method: Method) -> Scores:
        """Return the mean over photos of every score that the method has."""
        each = self.values(method).items()
        return {name: sum(values.values()) / len(values) for name, values in each if values}

    def interval(self, method: Method) -> Scores:
        """Return the half width of the 95 % interval of every mean that rests on two lights or more.

        A photo whose light has no name counts as one under a light of its own.
        """
        widths = {name: photo_interval(values, self.lights) for name, values in self.values(method).items()}
        return {name: width for name, width in widths.items() if math.isfinite(width)}

    def to_json(self) -> dict[str, Any]:
        """Return the content of metrics.json; scores that could not be computed are left out."""
        methods = list(dict.fromkeys(method for scores in self.photos.values() for method in scores))
        photos = {
            name: {
                **_finite(scores[self.default]),
                "methods": {m.value: _finite(s) for m, s in scores.items()},
                **({"light": self.lights[name]} if name in self.lights else {}),
            }
            for name, scores in self.photos.items()
        }
        return {
            "mean": {**self.mean(self.default), **_finite(self.truth)},
            "interval": {method.value: self.interval(method) for method in methods},
            "default_method": self.default.value,
            "methods": {method.value: self.mean(method) for method in methods},
            "confidence": {
                method.value: {"bins": bins, "falls": falls(bins)}
                for method, bins in self.confidence.items()
                if bins
            },
            "photos": photos,
            "verdicts": {
                "doubtful": sum(verdict.status is PhotoStatus.DOUBTFUL for verdict in self.verdicts.values()),
                "photos": {name: verdict.to_json() for name, verdict in self.verdicts.items()},
            },
            **({"skipped": self.skipped} if self.skipped else {}),
        }


@dataclass(frozen=True)
class Protocols:
    """What is computed, and how far."""

    unseen: bool = True
    """Add protocol B."""
    slow_seconds: float = 20.0
    """Seconds for a photo beyond which a method counts as slow, unless it is the default method."""
    slow_photos: int = 4
    """Test photos that a slow method is scored on, at least one: before it, nobody knows that it is slow."""

    def __post_init__(self) -> None:
        """Raise `ConfigError` for less than one photo."""
        if self.slow_photos < 1:
            raise ConfigError(
                f"--slow-photos cannot be {self.slow_photos}; what is slow is known after one photo."
            )


def evaluate(
    decomposition: Decomposition,
    model: ProbeModel | None,
    scene: Scene,
    *,
    methods: Sequence[Method] = (),
    device: torch.device | None = None,
    run: RunFolder | None = None,
    protocols: Protocols | None = None,
    true_object: Decomposition | None = None,
    prediction: PredictConfig | None = None,
    accuracy: LightAccuracy | None = None,
    on_photo: OnPhoto | None = None,
    on_view: OnView | None = None,
) -> Evaluation:
    """Score `methods`, the first being the default, on the scene's test photos.

    methods: by default those of `methods_for`. run: a folder that predictions are written to, by the names of
    photo and method. The predictions of the run's own default method, the first of `methods_for`, are also
    written under the photo's name alone. true_object: is relit with the predicted lights in place of the
    decomposition's own object. prediction: how lights are predicted, by default as after the preset `quick`.
    accuracy: of the run's maps, for their confidence. on_view: receives the default method's result for every
    photo. A photo that cannot be scored is left out and named in `Evaluation.skipped`. Raises `InputError`
    when no test photo is left.
    """
    if not scene.test:
        raise InputError(
            f"{scene.root} has no test photos to evaluate on; add some, or use more than one photo."
        )
    own, device = methods_for(model, prediction), device or torch.device("cpu")
    methods = methods or own
    decomposition = replace(decomposition, asset=decomposition.asset.to(device))
    predictor = Predictor(decomposition, model, device, config=prediction, accuracy=accuracy)
    known = any(photo.truth.environment is not None for photo in scene.test)
    stand_in = StandIn.of(true_object or decomposition, scene, device) if known else None
    judge = _Judge(decomposition, predictor, stand_in, protocols or Protocols(), device)
    result, materials = Evaluation(methods[0]), truth.MaterialScores()
    bins = {method: ConfidenceBins() for method in methods}

    def keep(found: ViewResult, photo: Photo, method: Method) -> None:
        result.photos[photo.name][method] = found.scores
        if found.true_light is not None:
            bins[method].add(found.prediction, found.true_light.environment)
        if run is not None:
            write_prediction(found.prediction, run.prediction_file(photo.name, ".exr", method.value))
            if method is own[0]:
                write_prediction(found.prediction, run.prediction_file(photo.name, ".exr"))
        if on_view is not None and method is methods[0]:
            on_view(found)

    def score(photo: Photo) -> None:
        try:
            view, light = judge.view(photo), judge.true_light(photo)
            first = judge.score(view, light, methods[0])
        except InputError as error:  # one photo that cannot serve must not cost the numbers of the others
            result.skipped[photo.name] = str(error)
            return
        try:
            materials.add(view)
        except InputError as error:
            truth.tell_unscored(error)
        scored = len(result.photos)
        result.photos[photo.name] = {}
        result.verdicts[photo.name] = first.prediction.verdict
        if photo.truth.light is not None:
            result.lights[photo.name] = photo.truth.light
        keep(first, photo, methods[0])
        for method in methods[1:]:
            if not judge.too_slow(method, scored):
                keep(judge.score(view, light, method), photo, method)

    for done, photo in enumerate(scene.test):
        score(photo)  # a function: a photo's pictures are gone before the next one's are read
        if on_photo is not None and photo.name not in result.skipped:
            on_photo(done + 1, len(scene.test))
    if not result.photos:
        raise InputError(
            f"No test photo of {scene.root} can be scored. {next(iter(result.skipped.values()))}"
        )
    result.confidence = {method: gathered.result() for method, gathered in bins.items()}
    result.truth = truth.asset_scores(decomposition, scene, materials, device)
    return result


@dataclass
class _Judge:
    """Scores one method on one photo."""

    decomposition: Decomposition
    predictor: Predictor
    stand_in: StandIn | None  # None: no true light to compare with
    protocols: Protocols
    device: torch.device
    slowest: dict[Method, float] = field(default_factory=dict)  # seconds for one photo

    def view(self, photo: Photo) -> TestView:
        return TestView.load(photo, self.decomposition, self.predictor.config.light_resolution, self.device)

    def true_light(self, photo: Photo) -> TrueLight | None:
        path, center = photo.truth.environment, self.decomposition.similarity.center
        if path is None:
            return None
        return TrueLight.load(path, photo.camera, center, self.predictor.config.light_resolution, self.device)

    def too_slow(self, method: Method, scored: int) -> bool:
        """Return whether a method takes too long for another photo after so many."""
        slow = self.slowest.get(method, 0) > self.protocols.slow_seconds
        return slow and scored >= self.protocols.slow_photos

    def score(self, view: TestView, light: TrueLight | None, method: Method) -> ViewResult:
        prediction = self.predictor.predict(view.pixels, view.camera, method, refuse=False)
        if method not in self.slowest and prediction.seconds["total"] < self.protocols.slow_seconds:
            # The first call also built tables and compiled kernels, which no later photo pays for.
            prediction = self.predictor.predict(view.pixels, view.camera, method, refuse=False)
        parts = _half_lights(view, self.predictor, method) if self.protocols.unseen else []
        image, *others = view.shown([prediction.environment.texels, *(light for _, light in parts)])
        seconds = prediction.seconds["total"]
        self.slowest[method] = max(seconds, self.slowest.get(method, 0))
        scores = {**view.score(image).to_json(), "seconds": seconds}
        unseen = [view.psnr(other, mask) for (mask, _), other in zip(parts, others, strict=True)]
        unseen = [value for value in unseen if math.isfinite(value)]
        scores |= {"psnr_unseen": sum(unseen) / len(unseen)} if unseen else {}
        del others
        if light is not None:
            scores |= light.scores(prediction)
            if self.stand_in is not None:
                scores |= self.stand_in.scores(view.photo.name, prediction.environment, light.environment)
        return ViewResult(view, prediction, image, scores, light)


def _half_lights(view: TestView, predictor: Predictor, method: Method) -> list[tuple[Tensor, Tensor]]:
    """Return lights (6, R, R, 3) predicted from halves of the object, each after the other's mask (H, W)."""
    masks, found = halves(view.pixels.alpha), []
    for i, mask in enumerate(masks):
        half = replace(view.pixels, alpha=np.where(mask, view.pixels.alpha, np.float32(0)))
        try:
            light = predictor.predict(half, view.camera, method, refuse=False).environment.texels
        except InputError:  # too little of the object is in this half
            continue
        found.append((torch.from_numpy(masks[i ^ 1]).to(light.device), light))
    return found


def _finite(scores: Scores) -> Scores:
    return {name: value for name, value in scores.items() if math.isfinite(value)}

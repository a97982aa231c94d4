"""The evaluation of a run into its folder: numbers, predictions and the report."""

import contextlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

import torch

from lightprobe.core.config.prediction import UNCHANGED, PredictConfig, PredictionOptions
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, InputError, LightprobeWarning
from lightprobe.core.failures import writing
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.core.stored import checked_object, read_object
from lightprobe.evaluation import (
    Evaluation,
    Protocols,
    ViewResult,
    can_be_oracle,
    evaluate,
    oracle_decomposition,
)
from lightprobe.models import Decomposition, LightAccuracy, ProbeModel
from lightprobe.prediction import Method, methods_for, recorded_config
from lightprobe.report import Report, evenly_spaced, view_pictures, write_report
from lightprobe.report.report import store_report
from lightprobe.report.run_info import read_phases, training_commands, training_facts
from lightprobe.runs.phases import open_scene
from lightprobe.runs.progress import OnProgress, silent
from lightprobe.scene.photo import Scene

_REMEDY = "remove it and evaluate again"


@dataclass(frozen=True)
class EvaluationOptions:
    """What of a run is evaluated."""

    methods: tuple[Method, ...] = ()
    """Methods to compare; by default all that the run is trained for."""
    protocols: Protocols = field(default_factory=Protocols)
    oracle: bool = False
    """Put the scene's true object in place of the reconstructed one; results go to the run's `oracle`."""
    slow: bool = False
    """Also score `optimize`."""
    settings: PredictionOptions = UNCHANGED
    """What changes of how the run predicts."""


@dataclass(frozen=True)
class EvaluatedRun:
    """What an evaluation found, and where it is."""

    evaluation: Evaluation
    numbers: Path
    page: Path
    usual_numbers: Path  # metrics.json of the run or of its folder `oracle`
    default: Method  # the run's own; its results stay in `usual_numbers` where `numbers` is another file


def evaluate_run(
    run_folder: Path | str,
    options: EvaluationOptions | None = None,
    *,
    scene_folder: Path | None = None,
    output: Path | None = None,
    device: str | torch.device = "auto",
    on_progress: OnProgress = silent,
) -> EvaluatedRun:
    """Evaluate a run on its test photos and write numbers, predictions and the report into its folder.

    scene_folder: where the run's scene is now, if it has moved. output: another file for the numbers, beside
    the run's. Raises `ConfigError` for another suffix of it, `InputError` for a run or scene that cannot be
    used or has no usable test photo, `ResourceError` when another process writes the run or disk or memory
    run out.
    """
    # What cannot be written is told now, not when all is done.
    if output is not None and (output.suffix.lower() != ".json" or output.is_dir()):
        raise ConfigError(f"Cannot write the numbers as '{output}': name a file that ends in .json.")
    run, where = RunFolder.open(Path(run_folder)), resolve_device(device)
    given = options or EvaluationOptions()
    if output is not None:
        _refuse_replacing(output, run.path)
    with writing(run):
        subject = _Subject.load(run, given, scene_folder, where)
        if output is not None:
            _refuse_replacing(output, subject.scene.root)
        numbers, page = destination(subject.out, subject.methods, subject.default)
        result, pictures = subject.evaluate(given, on_progress)
        metrics = result.to_json()
        write_json(numbers, metrics)
        phases = read_phases(run)
        made = {
            "evaluated": datetime.now().strftime("%Y-%m-%d %H:%M"),
            "by lightprobe": version("lightprobe"),
        }
        report = Report(
            title=f"lightprobe: {subject.scene.root.name}{', true object' if given.oracle else ''}",
            metrics=metrics,
            pictures=pictures,
            facts=subject.facts() | training_facts(phases) | made,
            commands=[*training_commands(phases, subject.scene.root), eval_command(given)] if phases else [],
            files=({} if given.oracle else {"object.glb": run.mesh_folder / "object.glb"})
            | {"metrics.json": numbers},
            photo_files={name: _photo_files(subject.out, name, subject.methods[0]) for name in pictures},
        )
        write_report(page, report)
        store_report(page, report)
        if output is not None:
            write_json(output, metrics)
    return EvaluatedRun(result, numbers, page, subject.out.metrics_file, subject.default)


def _refuse_replacing(numbers: Path, folder: Path) -> None:
    """Raise `ConfigError` where numbers would replace a file of a folder that holds no numbers of before."""
    if not numbers.is_file() or folder.resolve() not in numbers.resolve().parents:
        return
    with contextlib.suppress(InputError):
        if numbers.name != "metrics.json" and "default_method" in read_object(numbers, _REMEDY):
            return
    raise ConfigError(f"{numbers} is a file of {folder}, and would be replaced; give another name with -o.")


@dataclass(frozen=True)
class _Subject:
    """A run as it is evaluated."""

    decomposition: Decomposition  # whose asset is the true object if that was asked for
    true_object: Decomposition | None  # of a scene that brings it
    model: ProbeModel | None
    scene: Scene
    out: RunFolder
    prediction: PredictConfig
    default: Method  # the run's own
    methods: tuple[Method, ...]
    device: torch.device
    accuracy: LightAccuracy | None  # of the run's maps

    @staticmethod
    def load(
        run: RunFolder, given: EvaluationOptions, scene_folder: Path | None, device: torch.device
    ) -> "_Subject":
        prediction = given.settings.over(recorded_config(run))
        decomposition = Decomposition.load(run, device)
        model = ProbeModel.load(run.model_folder).to(device) if ProbeModel.exists(run.model_folder) else None
        scene = open_scene(run, scene_folder)
        true_object = _true_object(run, decomposition, scene, needed=given.oracle)
        every = methods_for(model, prediction)
        asked = (*(given.methods or every), *((Method.OPTIMIZE,) if given.slow else ()))
        evaluated = true_object if given.oracle and true_object is not None else decomposition
        return _Subject(
            evaluated,
            true_object,
            model,
            scene,
            run.oracle if given.oracle else run,
            prediction,
            every[0],
            default_first(asked, every[0]),
            device,
            None if given.oracle else LightAccuracy.load(run.model_folder),  # of the run's own object
        )

    def evaluate(
        self, given: EvaluationOptions, on_progress: OnProgress
    ) -> tuple[Evaluation, dict[str, dict[str, str]]]:
        """Return the evaluation, and the pictures of the photos that the report shows, by title."""
        pictures: dict[str, dict[str, str]] = {}
        shown = set(evenly_spaced([photo.name for photo in self.scene.test]))

        def keep(result: ViewResult) -> None:
            if result.view.photo.name in shown:
                pictures[result.view.photo.name] = view_pictures(result)

        result = evaluate(
            self.decomposition,
            self.model,
            self.scene,
            methods=self.methods,
            device=self.device,
            run=self.out,
            protocols=given.protocols,
            true_object=self.true_object,
            prediction=self.prediction,
            accuracy=self.accuracy,
            on_view=keep,
            on_photo=lambda done, total: on_progress("evaluate", done, total),
        )
        return result, pictures

    def facts(self) -> dict[str, str]:
        """Return what the report says of the scene and the object, by heading."""
        verdict, calibration = self.decomposition.verdict, self.decomposition.calibration
        return {
            "training photos": str(len(self.scene.train)),
            "test photos": str(len(self.scene.test)),
            "triangles": f"{len(self.decomposition.asset.mesh.faces):,}",
            "textures": f"{self.decomposition.asset.textures.size}²",
            **({} if verdict is None else {"object": verdict.sentence.removeprefix("The object is ")}),
            **({} if self.accuracy is None else {"light": self.accuracy.sentence}),
            **({} if calibration is None else {"brightness": f"calibrated, {calibration.source}"}),
        }


def default_first(methods: Sequence[Method], default: Method) -> tuple[Method, ...]:
    """Return the methods, each once, with the run's default one first if it is among them."""
    return tuple(sorted(dict.fromkeys(methods), key=lambda method: method is not default))


def destination(out: RunFolder, methods: Sequence[Method], default: Method) -> tuple[Path, Path]:
    """Return where numbers and page of `methods` go: never over those of the default method without it.

    The place beside them lies in the report's folder, which goes with the rest when a phase is restarted.
    """
    if out.metrics_file.is_dir():  # found out now, and not when all is computed
        raise InputError(f"{out.metrics_file} is a folder; {_REMEDY}.")
    if default in methods or not out.metrics_file.is_file():
        return out.metrics_file, out.report_file
    methods_there = read_object(out.metrics_file, _REMEDY).get("methods", {})
    if default.value not in checked_object(methods_there, out.metrics_file, _REMEDY, "methods"):
        return out.metrics_file, out.report_file
    folder = out.report_file.parent / "comparison"
    return folder / "metrics.json", folder / "index.html"


def eval_command(given: EvaluationOptions) -> str:
    """Return the command line of an evaluation; RUN stands for the run's folder."""
    methods, protocols, usual = given.methods, given.protocols, Protocols()
    words = ["lightprobe eval RUN", *(["--methods", *(m.value for m in methods)] if methods else [])]
    words += ["--no-unseen"] if not protocols.unseen else []
    words += ["--oracle-asset"] if given.oracle else []
    words += ["--slow"] if given.slow else []
    words += [f"--slow-photos {protocols.slow_photos}"] if protocols.slow_photos != usual.slow_photos else []
    words += [f"--{name.replace('_', '-')} {value}" for name, value in given.settings.given().items()]
    return " ".join(words)


def _true_object(
    run: RunFolder, decomposition: Decomposition, scene: Scene, *, needed: bool
) -> Decomposition | None:
    """Return the scene's true object, made once and kept in the run, or None where the scene has none.

    One that cannot be used costs a warning, unless it is `needed`.
    """
    if not needed and not can_be_oracle(scene):
        return None
    try:
        return oracle_decomposition(decomposition, scene, run.oracle.asset_file)
    except InputError as error:
        if needed:
            raise
        warnings.warn(f"The scene's true object is not used. {error}", LightprobeWarning, stacklevel=2)
        return None


def _photo_files(out: RunFolder, photo: str, method: Method) -> dict[str, Path]:
    """Return the files of a photo's prediction in the method's own folder, which no other method writes to."""
    suffixes = {"predicted light, EXR": ".exr", "confidence, EXR": ".confidence.exr"}
    return {name: out.prediction_file(photo, suffix, method.value) for name, suffix in suffixes.items()}

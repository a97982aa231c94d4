"""The two phases as steps of a run folder: recorded, resumable, reported."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import torch

from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.config.distillation import ExampleSource
from lightprobe.core.config.prediction import PredictConfig
from lightprobe.core.errors import ConfigError, InputError, LightprobeError, ResourceError
from lightprobe.core.run import RunFolder
from lightprobe.distillation import distill
from lightprobe.distillation.training import stages
from lightprobe.evaluation.simulated_photos import light_accuracy
from lightprobe.export import write_run_outputs
from lightprobe.light.environment import Environment, load_environments
from lightprobe.localization import KnownViews
from lightprobe.models import Decomposition, LightAccuracy, ProbeModel
from lightprobe.reconstruction import decompose
from lightprobe.runs.progress import OnProgress, clock
from lightprobe.runs.recorder import PhaseRecorder
from lightprobe.scene import load_scene
from lightprobe.scene.photo import Scene
from lightprobe.scene.record import read_record, scene_record

_SMALLEST_LOCATED = 64  # pixels: smaller photos have no features; views of such objects are made if asked for
MAP_RESOLUTION = 32  # texels along each cubemap edge of the maps of --hdri
TRAINED = "bench.json"  # in a run of the benchmark: the commit that trained it


@dataclass(frozen=True)
class UserMaps:
    """Environments of the user's that Phase II trains under as well, and where they came from."""

    source: str | None
    environments: list[Environment]

    @staticmethod
    def read(folder: Path | None, config: DistillConfig | None) -> "UserMaps":
        """Return the maps of a folder, none without one; called before Phase I, so that mistakes cost no time.

        Raises `InputError` for a folder without usable maps, `ConfigError` when Phase II would not use them.
        """
        if folder is None:
            return UserMaps(None, [])
        if config is not None and config.lessons is ExampleSource.TEACHER:
            raise ConfigError("--hdri changes nothing where no photos are re-rendered (lessons teacher).")
        return UserMaps(str(folder.resolve()), load_environments(folder, MAP_RESOLUTION))


def open_scene(run: RunFolder, folder: Path | None) -> Scene:
    """Load the scene of a run, from `folder` when it has moved, and check that it is still the same."""
    path = folder or Path(run.scene()["root"])
    if not path.is_dir():
        raise InputError(
            f"The photos of {run.path} are no longer in {path}; tell where they are with --scene FOLDER."
        )
    scene = load_scene(path)
    try:
        run.record_scene(scene_record(scene))
    except ConfigError as error:
        raise InputError(
            f"{path} is not the scene that {run.path} learnt from, or its photos, masks or cameras have changed; "
            "tell where that scene is with --scene FOLDER."
        ) from error
    return scene


def run_decompose(
    run: RunFolder,
    scene: Scene,
    config: DecomposeConfig,
    device: torch.device,
    seed: int,
    on_progress: OnProgress,
) -> Decomposition:
    """Phase I into the run folder, going on from the last checkpoint; a finished phase is only loaded."""
    run.record_scene(scene_record(scene))
    run.record_config("decompose", {"seed": seed, **asdict(config)})
    if run.asset_file.exists():
        return Decomposition.load(run, device, calibrated=False)
    recorder = PhaseRecorder(run, "decompose", run.checkpoints, on_progress)
    decomposition = decompose(scene, config, device, seed, recorder.progress(recorder.step))
    write_run_outputs(decomposition, run)
    decomposition.save(run)
    recorder.finish()
    return decomposition


def run_distill(
    run: RunFolder,
    decomposition: Decomposition,
    scene: Callable[[], Scene],
    config: DistillConfig,
    device: torch.device,
    seed: int,
    on_progress: OnProgress,
    user_maps: UserMaps,
    predict: PredictConfig,
) -> ProbeModel:
    """Phase II into the run folder, going on from the last checkpoint; a finished phase is only loaded.

    `predict`, how the run is to predict from then on, is kept with it.
    """
    run.record_config("distill", {"seed": seed, "hdri": user_maps.source, **asdict(config)})
    run.record_config("predict", asdict(predict))
    if ProbeModel.exists(run.model_folder):
        return ProbeModel.load(run.model_folder).to(device)
    recorder = PhaseRecorder(run, "distill", run.model_checkpoints, on_progress)
    first_step = {stage.name: stage.first_step for stage in stages(config)}

    def on_step(stage: str, step: int, steps: int, loss: float) -> None:
        recorder.step("distill", first_step[stage] + step, config.total_steps, loss)  # both stages as one

    model = distill(
        decomposition,
        scene(),
        config,
        device,
        seed,
        recorder.progress(on_step),
        environments=user_maps.environments,
        on_example=lambda done, total: on_progress("lessons", done, total),
    )
    model.save(run.model_folder)
    recorder.finish()
    return model


def is_learnt(run: RunFolder) -> bool:
    """Return whether Phase II is finished, and what simulated photos say of it, where they were asked for."""
    if not ProbeModel.exists(run.model_folder):
        return False
    wanted = run.sections().get("distill", {}).get("simulated_photos", 0)
    return wanted == 0 or LightAccuracy.is_decided(run.model_folder)


def keep_accuracy(
    run: RunFolder,
    decomposition: Decomposition,
    model: ProbeModel,
    predict: PredictConfig,
    device: torch.device,
    seed: int,
    on_progress: OnProgress,
) -> None:
    """Keep how well the object tells of its light, from simulated photos, for people and for the confidence.

    A training must not fail for it: what goes wrong is logged and kept, and the confidence is that of an
    average object. What a lack of memory prevents is tried again the next time.
    """
    if LightAccuracy.is_decided(run.model_folder) or model.config.simulated_photos == 0:
        return
    began, cameras = time.monotonic(), list(read_record(run).cameras["train"].values())
    try:
        accuracy = light_accuracy(
            decomposition,
            model,
            cameras,
            predict,
            device,
            seed,
            lambda done, total: on_progress("simulated photos", done, total),
            count=model.config.simulated_photos,
        )
        if accuracy is None:
            raise InputError("No camera of a training photo shows the object.")
    except LightprobeError as error:
        if not isinstance(error, ResourceError):
            LightAccuracy.save_unknown(run.model_folder, str(error))
        run.log(f"Photos of the object could not be simulated. {error}")
        return
    accuracy.save(run.model_folder)
    run.log(f"simulated photos predicted in {clock(time.monotonic() - began)}")


def keep_views(run: RunFolder, decomposition: Decomposition, scene: Scene, on_progress: OnProgress) -> None:
    """Keep what new photos are located by, so that it needs the training photos no more.

    Without the extra `photos` nothing is kept: a training must not fail for it, and `lightprobe locate` says what is
    missing.
    """
    largest = max(max(photo.camera.width, photo.camera.height) for photo in scene.train)
    if run.views_file.exists() or largest < _SMALLEST_LOCATED:
        return
    try:
        views = KnownViews.of(decomposition, scene, lambda done, total: on_progress("views", done, total))
    except ConfigError as error:
        run.log(f"New photos cannot be located yet. {error}")
        return
    views.save(run.views_file)


def restart_decompose(run: RunFolder) -> None:
    """Forget Phase I, and Phase II and the evaluation with it, as they build on it."""
    folders = (run.checkpoints.folder, run.mesh_folder, run.environment_folder)
    run.empty(outputs=(*folders, run.scene_file, run.calibration_file, *_second_outputs(run)))


def restart_distill(run: RunFolder) -> None:
    """Forget Phase II and the evaluation."""
    run.restart("distill", outputs=_second_outputs(run))
    run.restart("predict", outputs=())


def _second_outputs(run: RunFolder) -> tuple[Path, ...]:
    evaluated = (run.path / "predictions", run.metrics_file, run.report_file.parent, run.oracle.path)
    return (run.model_folder, *evaluated, run.path / TRAINED)

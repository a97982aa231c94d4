"""Training into a run folder: both phases, or one; every call goes on where an interrupted one stopped."""

import contextlib
import functools
from collections.abc import Iterator
from pathlib import Path

import torch

from lightprobe.core.config import DecomposeConfig, DistillConfig, Preset, settings
from lightprobe.core.config.prediction import PredictConfig
from lightprobe.core.device import resolve_device
from lightprobe.core.failures import writing
from lightprobe.core.run import RunFolder
from lightprobe.models import Decomposition
from lightprobe.report.run_info import fitted_preset
from lightprobe.runs.phases import (
    UserMaps,
    keep_accuracy,
    keep_views,
    open_scene,
    restart_decompose,
    restart_distill,
    run_decompose,
    run_distill,
)
from lightprobe.runs.preparing import prepared_in
from lightprobe.runs.progress import OnProgress, silent
from lightprobe.scene import load_scene
from lightprobe.scene.loading import load_checked_scene
from lightprobe.scene.photo import Scene
from lightprobe.scene.plain_photos import is_plain


def train_run(
    scene_folder: Path | str,
    output: Path | str,
    *,
    preset: Preset = Preset.QUICK,
    decompose: DecomposeConfig | None = None,
    distill: DistillConfig | None = None,
    predict: PredictConfig | None = None,
    device: str | torch.device = "auto",
    seed: int = 0,
    hdri: Path | str | None = None,
    restart: bool = False,
    on_progress: OnProgress = silent,
) -> RunFolder:
    """Train both phases on a folder of photos into the run folder `output`, and return the run.

    scene_folder: a scene, or plain photos or a video, of which a scene is then made in the run as by
    `prepare_scene`. decompose, distill, predict: the configurations of Phase I, Phase II and of predictions;
    by default the preset's. device: `auto`, `cpu`, `cuda`, or a device. seed: equal seeds give equal bits on
    a CPU. hdri: folder of .exr or .hdr environments, z up, that Phase II trains under as well. restart: throw
    away what the run holds. Otherwise a finished phase is kept and an interrupted one goes on. Raises
    `InputError` for unusable photos, cameras or maps, `ConfigError` for settings that cannot be used or are
    not those that the run was started with, `ResourceError` when another process writes the run or disk or
    memory run out, `ConvergenceError` when nothing usable comes out.
    """
    usual = settings(preset)
    first, second, prediction = (
        decompose or usual.decompose,
        distill or usual.distill,
        predict or usual.predict,
    )
    where, maps = resolve_device(device), UserMaps.read(None if hdri is None else Path(hdri), second)
    with _written(Path(scene_folder), Path(output), restart, on_progress) as (run, scene):
        found = run_decompose(run, scene, first, where, seed, on_progress)
        model = run_distill(run, found, lambda: scene, second, where, seed, on_progress, maps, prediction)
        keep_accuracy(run, found, model, prediction, where, seed, on_progress)
        keep_views(run, found, scene, on_progress)
    return run


def fit_run(
    scene_folder: Path | str,
    output: Path | str,
    *,
    preset: Preset = Preset.QUICK,
    decompose: DecomposeConfig | None = None,
    device: str | torch.device = "auto",
    seed: int = 0,
    restart: bool = False,
    on_progress: OnProgress = silent,
) -> RunFolder:
    """Train Phase I alone; the rest as in `train_run`."""
    where, first = resolve_device(device), decompose or settings(preset).decompose
    with _written(Path(scene_folder), Path(output), restart, on_progress) as (run, scene):
        run_decompose(run, scene, first, where, seed, on_progress)
    return run


@contextlib.contextmanager
def _written(
    folder: Path, output: Path, restart: bool, on_progress: OnProgress
) -> Iterator[tuple[RunFolder, Scene]]:
    """Hold the run at `output` for writing; yield it and the scene in `folder`, or that made of its plain photos."""
    scene = None if is_plain(folder) else load_checked_scene(folder)
    run = RunFolder.create(output)
    with writing(run):
        if restart:
            restart_decompose(run)
        yield run, scene or load_scene(prepared_in(run, folder, on_progress))


def distill_run(
    run_folder: Path | str,
    *,
    preset: Preset | None = None,
    distill: DistillConfig | None = None,
    predict: PredictConfig | None = None,
    device: str | torch.device = "auto",
    seed: int = 0,
    scene_folder: Path | None = None,
    hdri: Path | None = None,
    restart: bool = False,
    on_progress: OnProgress = silent,
) -> RunFolder:
    """Train Phase II of a run whose Phase I is finished; the rest as in `train_run`.

    preset: by default that of Phase I. scene_folder: where the run's scene is now, if it has moved.
    restart: throw away the run's Phase II and evaluation.
    """
    where, run = resolve_device(device), RunFolder.open(Path(run_folder))
    usual = settings(preset or fitted_preset(run))
    second, prediction = distill or usual.distill, predict or usual.predict
    maps = UserMaps.read(hdri, second)
    with writing(run):
        if restart:
            restart_distill(run)
        found = Decomposition.load(run, where, calibrated=False)
        scene = functools.partial(open_scene, run, scene_folder)
        model = run_distill(run, found, scene, second, where, seed, on_progress, maps, prediction)
        keep_accuracy(run, found, model, prediction, where, seed, on_progress)
    return run

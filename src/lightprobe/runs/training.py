"""Training into a run folder: both phases, or one of them. Every call goes on where an interrupted one
stopped.
"""

import contextlib
from pathlib import Path

import torch

from lightprobe.core.config import DecomposeConfig, DistillConfig, Preset, settings
from lightprobe.core.config.prediction import PredictConfig
from lightprobe.core.device import resolve_device
from lightprobe.core.failures import reporting_errors, writing
from lightprobe.core.processes import ALONE, Processes
from lightprobe.core.run import RunFolder
from lightprobe.models import Decomposition
from lightprobe.report.run_info import fitted_preset
from lightprobe.runs.preparing import prepared_in
from lightprobe.runs.progress import OnProgress, silent
from lightprobe.runs.stages import (
    UserMaps,
    keep_accuracy,
    keep_views,
    open_scene,
    restart_decompose,
    restart_distill,
    run_decompose,
    run_distill,
)
from lightprobe.scene import load_scene
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
    second = distill or settings(preset).distill
    where, maps = resolve_device(device), UserMaps.read(None if hdri is None else Path(hdri), second)
    scene = None if is_plain(Path(scene_folder)) else load_scene(Path(scene_folder))
    run = RunFolder.create(Path(output))
    with writing(run):
        if restart:
            restart_decompose(run)
        scene = scene or load_scene(prepared_in(run, Path(scene_folder), on_progress))
        first = decompose or settings(preset).decompose
        found = run_decompose(run, scene, first, where, seed, on_progress)
        prediction = predict or settings(preset).predict
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
    where, scene = (
        resolve_device(device),
        None if is_plain(Path(scene_folder)) else load_scene(Path(scene_folder)),
    )
    run = RunFolder.create(Path(output))
    with writing(run):
        if restart:
            restart_decompose(run)
        scene = scene or load_scene(prepared_in(run, Path(scene_folder), on_progress))
        run_decompose(run, scene, decompose or settings(preset).decompose, where, seed, on_progress)
    return run


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
    processes: Processes = ALONE,
) -> RunFolder:
    """Train Phase II of a run whose Phase I is finished; the rest as in `train_run`.

    preset: by default that of Phase I. scene_folder: where the run's scene is now, if it has moved.
    restart: throw away the run's Phase II and evaluation.
    processes: those of `core.processes.joined`, which train together; the first one alone writes the run.
    """
    where, run = resolve_device(device), RunFolder.open(Path(run_folder))
    usual = settings(preset or fitted_preset(run))
    second, prediction = distill or usual.distill, predict or usual.predict
    maps = UserMaps.read(hdri, second)
    with _held(run, processes):
        if restart and processes.first:
            restart_distill(run)
        found = Decomposition.load(run, where, calibrated=False)
        model = run_distill(
            run,
            found,
            lambda: open_scene(run, scene_folder),
            second,
            where,
            seed,
            on_progress if processes.first else silent,
            maps,
            prediction,
            processes,
        )
        if processes.first:
            keep_accuracy(run, found, model, prediction, where, seed, on_progress)
    return run


def _held(run: RunFolder, processes: Processes) -> contextlib.AbstractContextManager[None]:
    """Return what holds the run for writing in the first process, and writes nothing into it in the others."""
    return writing(run) if processes.first else reporting_errors()

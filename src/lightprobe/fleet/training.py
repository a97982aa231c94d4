"""Trainings of many scenes: a run for each, and an index of them.

SCENES/cup, SCENES/vase, ...  ->  RUNS/cup, RUNS/vase, ..., RUNS/index.parquet

A task is one scene. What a worker does with it, `train_scene`, goes on from the run's own checkpoints and knows nothing
of Ray.
"""

import contextlib
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch

from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.config.prediction import PredictConfig
from lightprobe.core.errors import InputError, LightprobeError, LightprobeWarning, LockedError
from lightprobe.core.failures import reporting_errors
from lightprobe.core.partial import partial_folder
from lightprobe.core.run import RunFolder
from lightprobe.core.stored import read_object
from lightprobe.core.timings import PhaseTiming, read_timings
from lightprobe.fleet.executor import Executor, Needs
from lightprobe.fleet.index import SceneIndex, SceneRow, State
from lightprobe.fleet.mirror import Mirror
from lightprobe.fleet.record import held
from lightprobe.fleet.storage import Place
from lightprobe.models import ProbeModel
from lightprobe.prediction import methods_for, recorded_config
from lightprobe.runs.evaluation import EvaluationOptions, evaluate_run
from lightprobe.runs.preparing import SCENE
from lightprobe.runs.progress import OnProgress, silent
from lightprobe.runs.training import train_run

# A lock dies with its process; a file server may take some minutes to notice that a machine is gone, and a
# machine that only the cluster has lost may still be at work.
_PATIENCE = 900.0  # seconds
_PAUSE = 2.0  # seconds between two tries


@dataclass(frozen=True)
class SceneOptions:
    """How all scenes of a call are trained."""

    decompose: DecomposeConfig
    distill: DistillConfig
    predict: PredictConfig
    seed: int = 0
    hdri: str | None = None
    evaluate: bool = False  # also on the test photos, by the method that the run uses


@dataclass(frozen=True)
class SceneTask:
    """A scene, and where its run goes."""

    scene: Place
    run: Place
    options: SceneOptions
    threads: int = 1
    device: str = "cpu"
    patience: float = _PATIENCE
    send_every: float = 60.0  # seconds after which a run in an object store is sent there


@dataclass(frozen=True)
class SceneSummary:
    """What became of all scenes."""

    rows: dict[str, SceneRow]  # by scene
    index: str

    @property
    def failures(self) -> dict[str, str]:
        """Why scenes have no run."""
        return {name: row.reason or "" for name, row in self.rows.items() if row.state == State.FAILED}


def train_fleet(
    scenes: Path | str,
    output: Path | str,
    executor: Executor,
    options: SceneOptions,
    *,
    needs: Needs | None = None,
    on_progress: OnProgress = silent,
) -> SceneSummary:
    """Train a run in `output` for every folder in `scenes`, and return what became of them.

    The same call goes on where an interrupted one stopped: finished scenes are left alone, interrupted ones
    go on from their checkpoints, and those that failed are tried again. needs: what a task takes. Raises
    `InputError` when there is no scene or the index of earlier calls cannot be used, `ConfigError` when these
    had other options or were of another folder of scenes, `LockedError` when another process writes `output`.
    """
    place, wanted, runs = Place.of(scenes), needs or Needs(), Place.of(output)
    found = [place.child(name) for name in place.names() if place.child(name).is_folder()]
    if not found:
        raise InputError(
            f"{place} holds no scenes: it needs a folder for each, as `lightprobe train` takes one."
        )
    with held(runs, {"scenes": str(place), "options": asdict(options)}, alone=False):
        index = SceneIndex(runs)
        done = {name for name, row in index.rows.items() if row.state == State.DONE}
        tasks = [
            SceneTask(scene, runs.child(scene.name), options, wanted.threads, wanted.device)
            for scene in found
            if scene.name not in done
        ]
        finished = len(found) - len(tasks)
        on_progress("scenes", finished, len(found))
        for outcome in executor.run(train_scene, tasks, wanted):
            name, run = outcome.task.scene.name, str(outcome.task.run)
            index.put(outcome.result or SceneRow(name, run, State.FAILED.value, outcome.lost))
            finished += 1
            on_progress("scenes", finished, len(found), name)
    rows = {scene.name: index.rows[scene.name] for scene in found}
    return SceneSummary(rows, str(runs.child(SceneIndex.NAME)))


def train_scene(task: SceneTask) -> SceneRow:
    """Train both phases of a scene, or go on with them, and return the row of its index."""
    torch.set_num_threads(task.threads)
    row = SceneRow(task.scene.name, str(task.run), State.FAILED.value)
    try:
        with reporting_errors(), warnings.catch_warnings(), _folders(task) as (scene, run, mirror):
            warnings.simplefilter("ignore", LightprobeWarning)
            on_progress = silent if mirror is None else mirror.on_progress
            _patiently(lambda: _train(task, scene, run, on_progress), task.patience)
            if mirror is not None:
                mirror.send()
            return _told(RunFolder(run), row)
    except LightprobeError as error:
        return replace(row, reason=str(error))


@contextlib.contextmanager
def _folders(task: SceneTask) -> Iterator[tuple[Path, Path, Mirror | None]]:
    """Yield scene and run on this machine, and what keeps the run in its object store, if it belongs there."""
    with contextlib.ExitStack() as stack:
        scene, run, mirror = task.scene.local, task.run.local, None
        if scene is None or run is None:
            base = stack.enter_context(partial_folder(Path(tempfile.gettempdir())))
            scene = scene or task.scene.fetch_folder(base / "scene")
            if run is None:
                run = base / "run"
                mirror = Mirror(run, task.run, task.send_every)
        yield scene, run, mirror


def _train(task: SceneTask, scene: Path, run: Path, on_progress: OnProgress) -> None:
    """Train a run, or go on with it, and evaluate it where that is asked for and not done."""
    settings = {key: value for key, value in vars(task.options).items() if key != "evaluate"}
    train_run(scene, run, device=task.device, on_progress=on_progress, **settings)
    folder = RunFolder(run)
    if not task.options.evaluate or folder.metrics_file.is_file():
        return
    method = methods_for(ProbeModel.load(folder.model_folder), recorded_config(folder))[0]
    prepared = run / SCENE  # of plain photos
    where = prepared if prepared.is_dir() else scene
    evaluate_run(
        run, EvaluationOptions((method,)), scene_folder=where, device=task.device, on_progress=on_progress
    )


def _patiently(work: Callable[[], None], patience: float) -> None:
    """Do `work`, again and again while another process holds the run, for `patience` seconds at most."""
    end = time.monotonic() + patience
    while True:
        try:
            work()
            return
        except LockedError:
            if time.monotonic() >= end:
                raise
            time.sleep(min(_PAUSE, patience))


def _told(run: RunFolder, row: SceneRow) -> SceneRow:
    """Return the row of a finished run."""
    timings = read_timings(run.timings_file)
    first, second = (timings.get(phase, PhaseTiming()) for phase in ("decompose", "distill"))
    metrics = read_object(run.metrics_file, "evaluate the run again") if run.metrics_file.is_file() else {}
    means = metrics.get("mean", {})
    return replace(
        row,
        state=State.DONE.value,
        phase1_seconds=first.seconds,
        phase2_seconds=second.seconds,
        memory=max((phase.memory for phase in (first, second) if phase.memory is not None), default=None),
        photos=len(run.scene().get("photos", {}).get("train", {})),
        relit=means.get("relit_psnr"),
        object=means.get("psnr_masked"),
    )

"""Trainings of many scenes: a run for each, and an index of them.

SCENES/cup, SCENES/vase, ...  ->  RUNS/cup, RUNS/vase, ..., RUNS/index.parquet
"""

from dataclasses import asdict, dataclass
from pathlib import Path

from lightprobe.core.errors import InputError
from lightprobe.fleet.executor import Executor, Needs
from lightprobe.fleet.index import SceneIndex, SceneRow, State
from lightprobe.fleet.record import check_record, held
from lightprobe.fleet.storage import Place
from lightprobe.fleet.training_task import SceneOptions, SceneTask, train_scene
from lightprobe.runs.progress import OnProgress, silent


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
    with held(runs):
        check_record(runs, {"scenes": str(place), "options": asdict(options)}, alone=False)
        index = SceneIndex(runs)
        _train(found, index, executor, options, wanted, runs, on_progress)
    rows = {scene.name: index.rows[scene.name] for scene in found}
    return SceneSummary(rows, str(runs.child(SceneIndex.NAME)))


def _train(
    found: list[Place],
    index: SceneIndex,
    executor: Executor,
    options: SceneOptions,
    needs: Needs,
    runs: Place,
    on_progress: OnProgress,
) -> None:
    """Run a task for each scene that is not finished, and put what became of it into the index."""
    done = {name for name, row in index.rows.items() if row.state == State.DONE}
    tasks = [
        SceneTask(scene, runs.child(scene.name), options, needs.threads, needs.device)
        for scene in found
        if scene.name not in done
    ]
    count = len(found) - len(tasks)
    on_progress("scenes", count, len(found))
    for outcome in executor.run(train_scene, tasks, needs):
        task = outcome.task
        index.put(
            outcome.result or SceneRow(task.scene.name, str(task.run), State.FAILED.value, outcome.lost)
        )
        count += 1
        on_progress("scenes", count, len(found), task.scene.name)

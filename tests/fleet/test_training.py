"""Fleets of trainings: a row for each scene, what is finished left alone, what failed tried again."""

import dataclasses
from collections.abc import Callable

import pyarrow.parquet as pq
import pytest

from lightprobe.core.errors import BusyError, ConfigError, InputError
from lightprobe.fleet import training_task
from lightprobe.fleet.executor import Needs
from lightprobe.fleet.index import SceneRow
from lightprobe.fleet.storage import Place
from lightprobe.fleet.training import train_fleet
from lightprobe.fleet.training_task import SceneTask, train_scene
from tests.fleet.micro import OPTIONS
from tests.fleet.stub import Stub
from tests.toy_scene import write_toy_scene


@pytest.fixture
def scenes(tmp_path):
    for name in ("cup", "vase", "empty"):
        (tmp_path / "scenes" / name).mkdir(parents=True)
    (tmp_path / "scenes" / "notes.txt").touch()
    return tmp_path / "scenes"


def finished(task):
    return SceneRow(task.scene.name, str(task.run), "done")


def test_every_folder_is_a_scene_and_has_a_row(scenes, tmp_path):
    executor = Stub(finished, lose=lambda task: task.scene.name == "vase")
    found = train_fleet(scenes, tmp_path / "runs", executor, OPTIONS, needs=Needs(cpus=2))
    assert list(found.rows) == ["cup", "empty", "vase"]
    assert list(found.failures) == ["vase"]
    assert "died in 4 tries" in found.failures["vase"]
    assert [str(task.run) for task in executor.tasks] == [f"{tmp_path}/runs/{name}" for name in found.rows]
    assert {task.threads for task in executor.tasks} == {2}
    assert pq.read_table(tmp_path / "runs" / "index.parquet")["state"].to_pylist() == ["done", "done", "failed"]


def test_finished_scenes_are_left_alone_and_failed_ones_tried_again(scenes, tmp_path):
    train_fleet(scenes, tmp_path / "runs", Stub(finished, lose=lambda task: task.scene.name == "vase"), OPTIONS)
    second, said = Stub(finished), []
    found = train_fleet(scenes, tmp_path / "runs", second, OPTIONS, on_progress=lambda *words: said.append(words[:3]))
    assert [task.scene.name for task in second.tasks] == ["vase"]
    assert said == [("scenes", 2, 3), ("scenes", 3, 3)]
    assert found.failures == {}


def test_runs_of_other_options_and_a_folder_without_scenes_are_told(scenes, tmp_path):
    train_fleet(scenes, tmp_path / "runs", Stub(finished), OPTIONS)
    with pytest.raises(ConfigError, match="seed = 0, not 1"):
        train_fleet(scenes, tmp_path / "runs", Stub(finished), dataclasses.replace(OPTIONS, seed=1))
    with pytest.raises(InputError, match="holds no scenes"):
        train_fleet(scenes / "cup", tmp_path / "others", Stub(finished), OPTIONS)


def test_a_scene_that_cannot_be_trained_on_says_why(scenes, tmp_path):
    row = train_scene(SceneTask(Place.of(scenes / "empty"), Place.of(tmp_path / "runs" / "empty"), OPTIONS))
    assert row.state == "failed"
    assert str(scenes / "empty") in row.reason


def held_until(tries: int) -> Callable[..., None]:
    """Return work that finds the run held by another process so many times."""
    left = [tries]

    def work(*_: object, **__: object) -> None:
        left[0] -= 1
        if left[0] >= 0:
            raise BusyError("It is being written by another lightprobe process.")

    return work


def test_a_run_that_a_dead_machine_still_holds_is_waited_for(monkeypatch, tmp_path):
    monkeypatch.setattr(training_task, "_PAUSE", 0.001)
    monkeypatch.setattr(training_task, "_told", lambda run, row: dataclasses.replace(row, state="done"))
    task = SceneTask(Place.of(tmp_path / "cup"), Place.of(tmp_path / "runs" / "cup"), OPTIONS, patience=5)
    monkeypatch.setattr(training_task, "train_run", held_until(3))
    assert train_scene(task).state == "done"
    monkeypatch.setattr(training_task, "train_run", held_until(10**9))
    row = train_scene(dataclasses.replace(task, patience=0.01))
    assert "being written by another" in row.reason


@pytest.mark.slow
def test_a_run_in_an_object_store_goes_on_from_what_arrived_there(monkeypatch, tmp_path):
    """Scene and run by URL; the machine dies in the middle of the second pass, another one goes on."""
    store = Place.of("memory://training")
    scene = write_toy_scene(tmp_path / "scene")
    for path in scene.rglob("*"):
        if path.is_file():
            store.child("scene", *path.relative_to(scene).parts).write(path.read_bytes())
    task = SceneTask(store.child("scene"), store.child("runs", "ball"), OPTIONS)
    real, steps = training_task.train_run, [0]

    def dying(*given, on_progress, **options):
        def update(stage, done, total, note=""):
            on_progress(stage, done, total, note)
            steps[0] += 1
            if stage == "pass2":
                raise MemoryError

        real(*given, on_progress=update, **options)

    monkeypatch.setattr("lightprobe.fleet.mirror._SECONDS", 0.0)
    monkeypatch.setattr(training_task, "train_run", dying)
    assert "memory" in train_scene(task).reason
    assert "checkpoints/step-000000004/state.json" in store.child("runs", "ball").files()
    monkeypatch.setattr(training_task, "train_run", real)
    row = train_scene(task)
    assert (row.state, row.photos) == ("done", 18)
    log = store.child("runs", "ball", "log.txt").read().decode()
    assert "decompose goes on from step 4" in log
    names = store.child("runs", "ball").files()
    assert {"mesh/asset.safetensors", "model/config.json"} <= names.keys()
    assert not [name for name in names if "partial" in name or name.startswith("checkpoints/step-000000002")]

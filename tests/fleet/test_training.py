"""Fleets of trainings: a row for each scene, what is finished left alone, what failed tried again."""

import dataclasses
from collections.abc import Callable

import pyarrow.parquet as pq
import pytest
import torch

from lightprobe.core.errors import BusyError, ConfigError, InputError
from lightprobe.core.run import RunFolder
from lightprobe.fleet import training as fleet
from lightprobe.fleet.executor import Needs
from lightprobe.fleet.index import SceneRow
from lightprobe.fleet.storage import Place
from lightprobe.fleet.training import SceneTask, train_fleet, train_scene
from tests.fleet.micro import OPTIONS
from tests.fleet.stub import Stub


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
    states = pq.read_table(tmp_path / "runs" / "index.parquet")["state"].to_pylist()
    assert states == ["done", "done", "failed"]


def test_finished_scenes_are_left_alone_and_failed_ones_tried_again(scenes, tmp_path):
    first, second, said = Stub(finished, lose=lambda task: task.scene.name == "vase"), Stub(finished), []
    train_fleet(scenes, tmp_path / "runs", first, OPTIONS)
    heard = lambda *words: said.append(words[:3])  # noqa: E731
    found = train_fleet(scenes, tmp_path / "runs", second, OPTIONS, on_progress=heard)
    assert [task.scene.name for task in second.tasks] == ["vase"]
    assert said == [("scenes", 2, 3), ("scenes", 3, 3)]
    assert found.failures == {}


def test_runs_of_other_options_or_scenes_and_a_folder_without_scenes_are_told(scenes, tmp_path):
    runs, others = tmp_path / "runs", tmp_path / "others"
    (others / "cup").mkdir(parents=True)
    train_fleet(scenes, runs, Stub(finished), OPTIONS)
    with pytest.raises(ConfigError, match="seed = 0, not 1"):
        train_fleet(scenes, runs, Stub(finished), dataclasses.replace(OPTIONS, seed=1))
    with pytest.raises(ConfigError, match=r"""scenes = .*/scenes", not .*/others"; choose another folder"""):
        train_fleet(others, runs, Stub(finished), OPTIONS)
    with pytest.raises(InputError, match="holds no scenes"):
        train_fleet(scenes / "cup", tmp_path / "more", Stub(finished), OPTIONS)


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
    monkeypatch.setattr(fleet, "_PAUSE", 0.001)
    monkeypatch.setattr(fleet, "_told", lambda run, row: dataclasses.replace(row, state="done"))
    task = SceneTask(Place.of(tmp_path / "cup"), Place.of(tmp_path / "runs" / "cup"), OPTIONS, patience=5)
    monkeypatch.setattr(fleet, "train_run", held_until(3))
    assert train_scene(task).state == "done"
    monkeypatch.setattr(fleet, "train_run", held_until(10**9))
    row = train_scene(dataclasses.replace(task, patience=0.01))
    assert "being written by another" in row.reason


def counting(dies_at: int | None) -> Callable[..., None]:
    """Return a stand-in for a training of ten steps, with a checkpoint after every second one."""

    def train(scene, folder, *, on_progress, **_):
        assert (scene / "photo.png").read_bytes() == b"photo"
        run = RunFolder.create(folder)
        before = run.checkpoints.latest()
        first = 0 if before is None else before[0]
        run.log(f"goes on from step {first}")
        for step in range(first + 1, 11):
            if step == dies_at:
                raise MemoryError
            if step % 2 == 0:
                run.checkpoints.save(step, {"x": torch.full((3,), float(step))}, {})
            on_progress("pass1", step, 10)
        run.record_scene({"root": str(scene), "photos": {"train": {"photo": {}}}})

    return train


def test_a_run_in_an_object_store_goes_on_from_what_arrived_there(monkeypatch):
    """Scene and run by URL; the machine dies in the middle, another one goes on."""
    store = Place.of("memory://training")
    store.child("scene", "photo.png").write(b"photo")
    task = SceneTask(store.child("scene"), store.child("runs", "ball"), OPTIONS, send_every=0.0)
    monkeypatch.setattr(fleet, "train_run", counting(dies_at=6))
    assert "memory" in train_scene(task).reason
    monkeypatch.setattr(fleet, "train_run", counting(dies_at=None))
    row = train_scene(task)
    assert (row.state, row.photos) == ("done", 1)
    said = store.child("runs", "ball", "log.txt").read().decode()
    assert [line.split()[-1] for line in said.splitlines()] == ["0", "4"]
    found = {name for name in store.child("runs", "ball").files() if name.endswith("state.json")}
    assert found == {f"checkpoints/step-0000000{step}/state.json" for step in ("08", "10")}

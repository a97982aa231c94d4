"""Work is done one piece after the other, and its results are kept for a while."""

import time

import pytest

from lightprobe.core.errors import InputError
from lightprobe.view import tasks as module
from lightprobe.view.tasks import TaskKind, Tasks
from lightprobe.web.errors import RefusedError
from lightprobe.web.pool import TaskState
from tests.view.conftest import PageProcess


@pytest.fixture
def tasks(tmp_path):
    made = Tasks(tmp_path / "tasks", PageProcess)
    yield made
    made.pool.close()


def submit(tasks, name="good"):
    return tasks.submit(TaskKind.PREDICT, "photo", {"name": name, "run_index": 0})


def finished(task):
    """Return a task when it is over."""
    task.answer.exception(20)
    return task


def test_a_task_leaves_the_files_that_it_tells(tasks):
    task = finished(submit(tasks))
    assert (task.state, task.stage) == (TaskState.DONE, "at work")
    assert task.file("light.exr").read_text() == "x"
    for name in ("../light.exr", "other", "", "/etc/passwd"):
        with pytest.raises(InputError, match="no file of that name"):
            task.file(name)
    about = task.to_json()
    assert (about["kind"], about["state"], about["about"]) == ("predict", "done", {"run_index": 0})


def test_a_failure_is_a_sentence_and_the_next_task_is_done(tasks):
    first, died, last = (submit(tasks, name) for name in ("fail", "die", "good"))
    assert finished(first).to_json()["sentence"] == "This cannot be done."
    assert finished(died).to_json()["sentence"] == "The process has ended."
    assert finished(last).state is TaskState.DONE
    assert not tasks.busy


def test_a_task_that_takes_too_long_is_stopped(tasks, monkeypatch):
    monkeypatch.setitem(module.DEADLINES, TaskKind.PREDICT, 0.1)
    assert "not finished after 0.1 s" in finished(submit(tasks, "wait")).to_json()["sentence"]


def test_too_many_are_refused_and_leave_no_folder(tasks, tmp_path):
    running = submit(tasks, "wait")
    while running.state is not TaskState.RUNNING:
        time.sleep(0.01)
    waiting = [submit(tasks) for _ in range(8)]
    with pytest.raises(RefusedError, match="wait already"):
        submit(tasks)
    assert len(list((tmp_path / "tasks").iterdir())) == 9
    tasks.pool.stop(running)
    assert all(finished(task).state is TaskState.DONE for task in waiting)


def test_the_oldest_results_are_thrown_away(tasks):
    made = [finished(submit(tasks)) for _ in range(62)]
    assert not made[0].folder.exists()
    assert made[-1].folder.exists()
    with pytest.raises(InputError, match="no longer kept"):
        tasks.get(made[0].id)
    assert len(tasks.all()) == 61

"""Ray itself: tasks whose processes and machines die. Its start takes seconds, so there are few tests."""

import os
import shutil
import sys
import threading
import time
from pathlib import Path

import pytest

from compare_runs import differences
from lightprobe.core.errors import ResourceError
from lightprobe.core.run import RunFolder
from lightprobe.fleet.executor import Needs
from lightprobe.fleet.ray_cluster import cluster
from lightprobe.fleet.storage import Place
from lightprobe.fleet.training import SceneTask, train_fleet, train_scene
from tests.cli.commands import fails
from tests.fleet.micro import OPTIONS
from tests.toy_scene import write_toy_scene

LITTLE = Needs(memory=0.1, retries=1)


# Ray reads its token once for a process, whichever cluster comes first
os.environ.setdefault("RAY_AUTH_TOKEN", os.urandom(32).hex())


@pytest.mark.long
def test_a_process_that_dies_costs_its_own_task_alone(tmp_path):
    def work(number: int) -> tuple[int, str | None]:
        with open(tmp_path / str(number), "a") as file:
            file.write("x")
        if number == 3 or (number == 4 and (tmp_path / "4").read_text() == "x"):
            os._exit(1)
        if number == 5:
            raise ValueError("five")
        return number, os.environ.get("OMP_NUM_THREADS")

    with cluster() as executor:
        outcomes = {outcome.task: outcome for outcome in executor.run(work, iter(range(8)), LITTLE)}
        with pytest.raises(ResourceError, match="No machine has what a task needs, 1 CPUs, 3 GPUs"):
            next(executor.run(work, [0], Needs(gpus=3, memory=0.1)))
    assert sorted(outcomes) == list(range(8))
    done = {task: outcome.result[0] for task, outcome in outcomes.items() if outcome.result}
    assert done == {number: number for number in (0, 1, 2, 4, 6, 7)}
    assert outcomes[0].result[1] == "1"
    assert "died in 2 tries" in outcomes[3].lost
    assert (tmp_path / "3").read_text() == "xx"
    assert "five" in outcomes[5].lost


@pytest.mark.long
def test_scenes_of_a_machine_that_dies_are_finished_elsewhere_with_the_same_bits(monkeypatch, tmp_path):
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("RAY_worker_niceness", "0")  # else its workers wait for other tests that run beside
    monkeypatch.setenv("PYTHONPATH", f"{Path(__file__).parents[2] / 'src'}:{Path(__file__).parents[2]}")
    from ray.cluster_utils import Cluster

    first = write_toy_scene(tmp_path / "scenes" / "first")
    shutil.copytree(first, tmp_path / "scenes" / "second")
    runs = tmp_path / "runs"
    alone = train_scene(SceneTask(Place.of(first), Place.of(tmp_path / "alone"), OPTIONS))
    assert alone.state == "done", alone.reason
    machines = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    try:
        doomed = [machines.add_node(num_cpus=1) for _ in range(2)][1]

        def kill() -> None:
            deadline = time.monotonic() + 240
            while len(list(runs.glob("*/checkpoints/step-*"))) < 2 and time.monotonic() < deadline:
                time.sleep(0.02)
            machines.remove_node(doomed, allow_graceful=False)

        killer = threading.Thread(target=kill)
        with cluster(machines.address) as executor:
            killer.start()
            found = train_fleet(tmp_path / "scenes", runs, executor, OPTIONS, needs=LITTLE)
            killer.join()
    finally:
        machines.shutdown()
    assert found.failures == {}
    assert any("goes on from step" in RunFolder(runs / name).log_file.read_text() for name in found.rows)
    for name in found.rows:
        assert list(differences(tmp_path / "alone", runs / name)) == []


def test_a_cluster_that_is_not_there_is_told(monkeypatch, capsys, tmp_path):
    import ray

    def silent(**_: object) -> None:
        raise ConnectionError("Ray cluster at 192.0.2.1:6379 did not answer\nTraceback")

    monkeypatch.setattr(ray, "init", silent)
    (tmp_path / "scenes").mkdir()
    command = ["fleet", "train", tmp_path / "scenes", "-o", tmp_path / "runs", "--address", "192.0.2.1:6379"]
    assert fails(command, capsys, ["192.0.2.1:6379", "did not answer"]) == ResourceError.exit_code


def test_without_ray_the_extra_is_named(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "ray", None)
    fails(["fleet", "predict", "photos.parquet", "-o", str(tmp_path)], capsys, ["lightprobe[cluster]"])

"""Measures a fleet: what it costs beside the work itself, and what it does when a machine dies.

    python -m benchmarks fleet load [--rows 100000] [--ray]
    python -m benchmarks fleet photos RUN [--photos 400] [--alone 400] [--workers 1] [--method probe-net] [--sources]
    python -m benchmarks fleet nodes SCENE [--nodes 3] [--scenes 6]

load: predictions that do nothing, so that what is left is reading the table, handing out tasks and writing the index; with
--ray the tasks go through Ray, without it they are called here.
photos: the test photos of a run whose scene is still in place, again and again: --photos of them by a fleet of
--workers tasks at a time, --alone of them by one process before and after it; with --sources suns and lamps are looked
for, too. The index must have a row for each photo, and one of them fails.
nodes: copies of a scene, trained for a few steps on a simulated cluster of that many machines with one core each, of
which one is killed once checkpoints exist; every run must have the bits of one that was trained alone.

Everything goes to a temporary folder. Prints what was found, and ends with 1 where something is missing or differs.
"""

import math
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import pyarrow
import pyarrow.parquet

from benchmarks import command_line
from compare_runs import differences
from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.config.prediction import Method, PredictConfig
from lightprobe.core.memory import peak_memory
from lightprobe.core.run import RunFolder
from lightprobe.fleet.executor import Executor, Needs, Outcome, Result, Task
from lightprobe.fleet.index import PhotoRow, State
from lightprobe.fleet.predicting import Chunk, map_place, predict_chunk, predict_fleet
from lightprobe.fleet.ray_cluster import cluster
from lightprobe.fleet.storage import Place
from lightprobe.fleet.table import TableRow
from lightprobe.fleet.training import SceneOptions, SceneTask, train_fleet, train_scene
from lightprobe.jobs import LightOptions
from lightprobe.scene.record import read_record

CHUNK = 100  # photos of a task that does nothing
PATIENCE = 600.0  # seconds until checkpoints must have come

FEW_STEPS = SceneOptions(
    DecomposeConfig(
        pass1_iterations=4,
        pass2_iterations=2,
        pass3_iterations=2,
        pass1_side=32,
        pass2_side=32,
        pass3_texture_size=96,
        lattice_cells=12,
        hull_voxels=24,
        hash_levels=4,
        hash_finest=32,
        light_resolution=8,
        teacher_resolution=8,
        texture_size=64,
        light_solve_pixels=256,
        checkpoint_every=2,
        trial_steps=0,
        unwrap_seconds=3600,  # a busy machine changes no bit
    ),
    DistillConfig(
        steps=4,
        samples=32,
        light_resolution=8,
        width=8,
        checkpoint_every=2,
        sphere_steps=0,
        synthetic_lessons=1,
        pretrained=False,
    ),
    PredictConfig(light_resolution=8),
)


class Nothing:
    """An executor that calls `nothing` in place of every task: through another executor, or here without one."""

    def __init__(self, executor: Executor | None):
        self._executor = executor

    def run(
        self, function: Callable[[Task], Result], tasks: Iterable[Task], needs: Needs
    ) -> Iterator[Outcome[Task, Result]]:
        """Yield rows without any work."""
        if self._executor is None:
            return (Outcome(task, nothing(task)) for task in tasks)  # type: ignore[arg-type]
        return self._executor.run(nothing, tasks, needs)  # type: ignore[arg-type]


def nothing(chunk: Chunk) -> list[PhotoRow]:
    """Return rows as of predictions, with scores that differ from row to row, as those that are measured do."""
    return [
        PhotoRow(
            row.row,
            row.run,
            row.photo,
            State.DONE.value,
            map="/".join(map_place(row.row)) + ".exr",
            method=Method.PROBE_NET.value,
            verdict="good",
            explained=math.sin(row.row),
            overlap=math.sin(2 * row.row),
            confidence=math.sin(3 * row.row),
            seconds=math.sin(4 * row.row),
        )
        for row in chunk.rows
    ]


def measure_load(rows: int, on_ray: bool) -> int:
    """Write a table, go through all of them without work, and print rows per second, bytes per row and memory."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        root = Path(folder)
        columns = {
            "run": [f"s3://bucket/runs/object-{row // 1000:05d}" for row in range(rows)],
            "photo": [f"s3://bucket/photos/object-{row // 1000:05d}/{row:09d}.jpg" for row in range(rows)],
        }
        pyarrow.parquet.write_table(pyarrow.table(columns), root / "photos.parquet")
        executor: Executor = Nothing(stack.enter_context(cluster()) if on_ray else None)
        begin, used = time.perf_counter(), time.process_time()
        asked, needs = (root / "photos.parquet", root / "out", executor), Needs(memory=0.1)
        found = predict_fleet(*asked, chunk=CHUNK, needs=needs)
        seconds, used = time.perf_counter() - begin, time.process_time() - used
        again = time.perf_counter()
        predict_fleet(*asked, chunk=CHUNK, needs=needs)
        resumed = time.perf_counter() - again
        size = sum(path.stat().st_size for path in (root / "out" / "index").iterdir())
    print(
        f"{rows} rows, {-(-rows // CHUNK)} tasks{' through Ray' if on_ray else ''}: {seconds:.2f} s, "
        f"{rows / seconds:.0f} rows/s, {rows / CHUNK / seconds:.0f} tasks/s; of it "
        f"{used:.2f} s of computing here, {rows / used:.0f} rows/s"
    )
    memory = peak_memory() or 0
    print(
        f"index {size / rows:.1f} bytes per row; to go on with it {resumed:.2f} s; {memory:.2f} GiB at most"
    )
    return 0 if found.done == rows else 1


def measure_photos(run: Path, photos: int, alone: int, workers: int, options: LightOptions) -> int:
    """Predict by one process and by a fleet, and print photos per second of both."""
    record = read_record(RunFolder.open(run))
    test = [str(path) for path in sorted((record.root / "test").glob("r_???.png"))]
    with tempfile.TemporaryDirectory() as folder:
        root, camera = Path(folder), str(record.root / "transforms_test.json")
        files = [test[row % len(test)] for row in range(photos)]
        files[photos // 2] = "gone.png"
        columns = {"run": [str(run.resolve())] * photos, "photo": files, "camera": [camera] * photos}
        pyarrow.parquet.write_table(pyarrow.table(columns), root / "photos.parquet")
        rows = [TableRow(row, str(run.resolve()), files[row], camera) for row in range(min(alone, photos))]
        before = _alone(rows, root, options)
        with cluster() as executor:
            _fleet(root, "warm", executor, options, workers, 2)  # compiles, and reads libraries
            fleet = _fleet(root, "out", executor, options, workers, photos)
        after = _alone(rows, root, options)
        single = (before + after) / 2
        table = pyarrow.parquet.read_table(root / "out" / "index").to_pydict()
    missing = sorted(set(range(photos)) - set(table["row"]))
    ends = zip(table["state"], table["reason"], strict=True)
    failed = [reason for state, reason in ends if state == State.FAILED]
    print(
        f"{photos} photos, {options.method}{', sources' if options.sources else ''}: one process {before:.2f} "
        f"photos/s before, {after:.2f} after; fleet of {workers}: {fleet:.2f} photos/s, "
        f"{fleet / (workers * single):.2f} of {workers} x one process"
    )
    print(f"{len(table['row'])} rows, {len(missing)} missing, {len(failed)} failed: {failed[:1]}")
    return 0 if not missing and len(table["row"]) == photos and len(failed) == 1 else 1


def _fleet(
    root: Path, name: str, executor: Executor, options: LightOptions, workers: int, photos: int
) -> float:
    """Return photos per second of a fleet, of the first `photos` rows."""
    import ray

    table = pyarrow.parquet.read_table(root / "photos.parquet").slice(0, photos)
    pyarrow.parquet.write_table(table, root / f"{name}.parquet")
    begin = time.perf_counter()
    needs = Needs(cpus=ray.cluster_resources()["CPU"] / workers, memory=1)  # as many tasks at once as wanted
    predict_fleet(root / f"{name}.parquet", root / name, executor, options=options, needs=needs)
    return photos / (time.perf_counter() - begin)


def _alone(rows: Sequence[TableRow], root: Path, options: LightOptions) -> float:
    """Return photos per second of this process, on one thread, after a first photo."""
    place = Place.of(root)
    predict_chunk(Chunk(tuple(rows[:1]), place, place.child("alone"), options))
    begin = time.perf_counter()
    predict_chunk(Chunk(tuple(rows), place, place.child("alone"), options))
    return len(rows) / (time.perf_counter() - begin)


def measure_nodes(scene: Path, nodes: int, scenes: int) -> int:
    """Train copies of a scene on simulated machines, kill one, and compare with a training alone."""
    from ray.cluster_utils import Cluster

    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for number in range(scenes):
            shutil.copytree(scene, root / "scenes" / f"scene{number}")
        alone = train_scene(SceneTask(Place.of(scene.resolve()), Place.of(root / "alone"), FEW_STEPS))
        machines = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
        try:
            doomed = [machines.add_node(num_cpus=1) for _ in range(nodes)][-1]
            killer = threading.Thread(target=_kill, args=(machines, doomed, root / "runs", nodes))
            with cluster(machines.address) as executor:
                killer.start()
                begin = time.perf_counter()
                needs, places = Needs(memory=0.1), (root / "scenes", root / "runs")
                found = train_fleet(*places, executor, FEW_STEPS, needs=needs, on_progress=_say)
                seconds = time.perf_counter() - begin
                killer.join()
        finally:
            machines.shutdown()
        logs = {name: (root / "runs" / name / "log.txt").read_text() for name in found.rows}
        resumed = [name for name, log in logs.items() if "goes on from step" in log]
        other = {name: list(differences(root / "alone", root / "runs" / name)) for name in found.rows}
    same = sum(not lines for lines in other.values())
    for name, lines in other.items():
        print("\n".join(f"{name}: {line}" for line in lines[:2]), end="\n" if lines else "")
    finished = scenes - len(found.failures)
    print(
        f"{nodes} machines, one killed: {finished} of {scenes} scenes finished in {seconds:.0f} s, "
        f"{len(resumed)} went on from a checkpoint, {same} have the bits of a training alone"
    )
    return 0 if alone.state == State.DONE and not found.failures and same == scenes and resumed else 1


def _say(stage: str, done: int, total: int, note: str = "") -> None:
    print(f"{stage}: {done} of {total} {note}", flush=True)


def _kill(machines: object, doomed: object, runs: Path, count: int) -> None:
    """Kill a machine once as many runs have checkpoints as there are machines."""
    end = time.monotonic() + PATIENCE
    begun = set[Path]()
    while len(begun) < count and time.monotonic() < end:
        begun = {path.parents[1] for path in runs.glob("*/checkpoints/step-*")}
        time.sleep(0.02)
    print("a machine is killed", flush=True)
    machines.remove_node(doomed, allow_graceful=False)  # type: ignore[attr-defined]


def main(words: Sequence[str]) -> int:
    """Read the command line, measure, and return the exit status."""
    parser = command_line(__doc__)
    kinds = parser.add_subparsers(dest="kind", required=True)
    load = kinds.add_parser("load")
    load.add_argument("--rows", type=int, default=100_000)
    load.add_argument("--ray", action="store_true")
    photos = kinds.add_parser("photos")
    photos.add_argument("run", type=Path, metavar="RUN")
    for name, value in (("photos", 400), ("alone", 400), ("workers", 1)):
        photos.add_argument(f"--{name}", type=int, default=value)
    photos.add_argument("--method", type=Method, default=Method.PROBE_NET)
    photos.add_argument("--sources", action="store_true")
    nodes = kinds.add_parser("nodes")
    nodes.add_argument("scene", type=Path, metavar="SCENE")
    nodes.add_argument("--nodes", type=int, default=3)
    nodes.add_argument("--scenes", type=int, default=6)
    given = parser.parse_args(words)
    if given.kind == "load":
        return measure_load(given.rows, given.ray)
    if given.kind == "photos":
        options = LightOptions(given.method, sources=given.sources)
        return measure_photos(given.run, given.photos, given.alone, given.workers, options)
    return measure_nodes(given.scene, given.nodes, given.scenes)

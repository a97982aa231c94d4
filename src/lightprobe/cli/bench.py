"""bench: trains and evaluates every scene, keeps a record of every evaluation, and writes the tables from them."""

import functools
from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff

from lightprobe.cli.benchmark import LOSSES, LOSSES_SCENE, Benchmark
from lightprobe.cli.options import option
from lightprobe.core.config import Preset
from lightprobe.core.errors import ConfigError, ResourceError
from lightprobe.core.files import write_bytes
from lightprobe.light.files import environment_files
from lightprobe.report.bench_results import BenchResults
from lightprobe.report.bench_scenes import BENCH_SCENES
from lightprobe.report.paper_tables import paper_page
from lightprobe.report.records import Kind, read_records
from lightprobe.report.results import results_page


class Step(StrEnum):
    """A part of the benchmark."""

    RUN = "run"
    PAPER = "paper"
    SEEDS = "seeds"
    LESSONS = "lessons"
    LOSSES = "losses"


def bench(
    *,
    scenes: Annotated[
        tuple[str, ...], option(help="Names of scenes. kettle and figure are for releases.")
    ] = BENCH_SCENES,
    data: Annotated[Path, option(metavar="DIR", help="Where the scenes' folders are, at most one folder down.")] = Path(
        "data"
    ),
    output: Annotated[Path, option(aliases=["-o"], metavar="FOLDER", help="Runs and variants.")] = Path("runs/bench"),
    runs: Annotated[
        Path | None, option(metavar="FOLDER", help="Finished runs named as the scenes, if not there.")
    ] = None,
    preset: Annotated[Preset, option(help="Size of the training.")] = Preset.QUICK,
    steps: Annotated[
        tuple[Step, ...], option(help="What to do: runs, the paper's settings, other seeds, lessons, losses.")
    ] = tuple(Step),
    seeds: Annotated[
        tuple[int, ...], option(help="The first is every run's; the others train the default and the losses again.")
    ] = (0, 1, 2),
    paper_iterations: Annotated[
        tuple[int, ...],
        option(metavar="I II", help="Steps of each pass of Phase I and of Phase II in runs with the paper's settings."),
    ] = (),
    slow_photos: Annotated[int, option(help="Test photos for methods that take more than 20 s each.")] = 2,
    hdri: Annotated[
        Path | None,
        option(
            metavar="DIR", help="Folder of .exr or .hdr environments, z up: one more Phase II trains under them, too."
        ),
    ] = None,
    records: Annotated[
        Path | None, option(metavar="DIR", help="Where records are kept; benchmarks/records, else FOLDER/records.")
    ] = None,
    results: Annotated[
        Path | None, option(metavar="RESULTS.md", help="The page; by default benchmarks/RESULTS.md, else in FOLDER.")
    ] = None,
    tables_only: Annotated[FlagCreatePairsOff[bool], option(help="Only write the pages from the records.")] = False,
) -> None:
    """Train and evaluate every scene with every method, and write the tables.

    Every finished evaluation leaves a small record, and the pages are written from the records alone: the same command
    goes on where an interrupted one stopped, on another day too. A record is made anew once its file is deleted. With
    --paper-iterations, the scenes are also trained with the paper's settings. Scenes that are not in DIR are left out
    and named. Beside RESULTS.md, or in docs/, paper-tables.md sets the paper's tables beside ours.

    Examples:
      lightprobe bench --data ~/light-data
      lightprobe bench --data ~/light-data --scenes spot --steps run seeds --runs runs
      lightprobe bench --data ~/light-data --scenes spot cape --steps paper --paper-iterations 1500 2000
      lightprobe bench --data ~/light-data --hdri ~/hdris
      lightprobe bench --tables-only
    """
    usual = Path("benchmarks") if Path("benchmarks").is_dir() else output
    pages = Pages(records or usual / "records", results or usual / "RESULTS.md", beside=results is not None)
    if tables_only:
        pages.write_alone()
        return
    _check(preset, steps, seeds, paper_iterations, hdri)
    benchmark = Benchmark(output, runs or output / "runs", pages.records, preset, seeds, slow_photos, data, hdri)
    _make(benchmark, _pieces(benchmark, _found(scenes, data), steps, paper_iterations), pages, scenes)


def _make(benchmark: Benchmark, pieces: Sequence[Callable[[], None]], pages: "Pages", scenes: Sequence[str]) -> None:
    """Make the pieces, with new pages after each; raise `ResourceError` at the end if one failed."""
    for piece in pieces:
        piece()
        pages.write(scenes)
    pages.name()
    if benchmark.failed:
        raise ResourceError(f"These pieces failed, their messages stand above: {', '.join(benchmark.failed)}.")


def _pieces(
    benchmark: Benchmark, found: dict[str, Path], steps: Sequence[Step], paper_iterations: tuple[int, ...]
) -> list[Callable[[], None]]:
    """Return everything to do, the most wanted first."""
    own = benchmark.preset is not Preset.PAPER  # which has lessons of its own, and no other settings beside it
    pieces: list[Callable[[], None]] = []
    if Step.RUN in steps:
        pieces += [functools.partial(benchmark.scene, *scene) for scene in found.items()]
    if Step.PAPER in steps and paper_iterations and own:
        pieces += [functools.partial(benchmark.paper, *scene, *paper_iterations) for scene in found.items()]
    if Step.SEEDS in steps:
        pieces += [
            functools.partial(benchmark.seed, *scene, seed) for scene in found.items() for seed in benchmark.seeds[1:]
        ]
    if Step.LESSONS in steps and own:
        pieces += [
            functools.partial(benchmark.lessons, kind, *scene)
            for scene in found.items()
            for kind in benchmark.all_lessons
        ]
    if Step.LOSSES in steps and LOSSES_SCENE in found:
        losses = [(variant, seed) for seed in benchmark.seeds for variant in LOSSES]
        pieces += [functools.partial(benchmark.loss, *loss, found[LOSSES_SCENE]) for loss in losses]
    return pieces


class Pages:
    """RESULTS.md and paper-tables.md, which are written from a folder of records."""

    def __init__(self, records: Path, results: Path, *, beside: bool):
        """Take the folder and the first page; the other goes beside it, or to docs/ if there is one."""
        self.records, self.results = records, results
        self.paper = (results.parent if beside or not Path("docs").is_dir() else Path("docs")) / "paper-tables.md"

    def write(self, scenes: Sequence[str]) -> None:
        """Write both pages; those of `scenes` that have no record are named."""
        found = read_records(self.records)
        scored = {record.scene for record in found if record.kind is Kind.RUN}
        missing = [f"{name}, for which there are no numbers." for name in scenes if name not in scored]
        everything = BenchResults(found, missing)
        write_bytes(self.results, results_page(everything).encode())
        write_bytes(self.paper, paper_page(everything).encode())

    def write_alone(self) -> None:
        """Write both pages where nothing else is done; raise `ConfigError` where there are no records."""
        if not self.records.is_dir():
            raise ConfigError(f"There is no folder {self.records}; tell where the records are with --records DIR.")
        self.write(())
        self.name()

    def name(self) -> None:
        """Print where the pages are."""
        print(f"Results: {self.results}\nThe paper's tables: {self.paper}")


def _found(scenes: Sequence[str], data: Path) -> dict[str, Path]:
    """Return the folders of the scenes that there are, and name the others; raise `ConfigError` for none."""
    found = {name: folder for name in scenes if (folder := find_scene(data, name)) is not None}
    for name in scenes:
        if name not in found:
            print(f"SKIPPED {name}: there is no scene of that name in {data}; tell where it is with --data DIR.")
    if not found:
        raise ConfigError(f"None of {', '.join(scenes)} is in {data}; tell where they are with --data DIR.")
    return found


def find_scene(data: Path, name: str) -> Path | None:
    """Return the folder of a scene in `data` or one folder down, or None."""
    places = [data / name, *sorted(folder / name for folder in data.glob("*") if folder.is_dir())]
    return next((place for place in places if place.is_dir()), None)


def _check(
    preset: Preset, steps: Sequence[Step], seeds: Sequence[int], paper_iterations: Sequence[int], hdri: Path | None
) -> None:
    """Raise now what would otherwise stop a piece hours later."""
    if not seeds or len(set(seeds)) < len(seeds) or min(seeds) < 0:
        raise ConfigError("--seeds must be one number or more, none negative and none twice.")
    if paper_iterations and (len(paper_iterations) != 2 or min(paper_iterations) < 1):
        raise ConfigError("--paper-iterations must be two numbers of 1 or more: steps of Phase I and of Phase II.")
    if Step.PAPER in steps and set(steps) != set(Step) and not paper_iterations:
        raise ConfigError("--steps paper needs --paper-iterations I II; the paper's own are 40000 30000.")
    if preset is Preset.PAPER and (hdri is not None or paper_iterations):
        given = "--hdri" if hdri is not None else "--paper-iterations"
        raise ConfigError(f"{given} changes nothing with --preset paper, all of whose runs are the paper's.")
    if hdri is not None:
        environment_files(hdri)

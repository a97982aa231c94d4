"""A benchmark: every scene trained and evaluated, a record of every evaluation, and the pages from them.

Every finished piece leaves a record, so the same call goes on where an interrupted one stopped.
"""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path

from lightprobe.core.config import Preset
from lightprobe.core.errors import ConfigError, ResourceError
from lightprobe.core.files import write_bytes
from lightprobe.evaluation import Protocols
from lightprobe.light.files import environment_files
from lightprobe.report.bench_results import BenchResults
from lightprobe.report.paper_tables import paper_page
from lightprobe.report.records import Kind, read_records
from lightprobe.report.results import results_page
from lightprobe.runs.benchmark import LOSSES, LOSSES_SCENE, Benchmark, BenchOptions, RunCommand, Say, Step

__all__ = ["BenchOptions", "Pages", "Step", "find_scene", "run_bench", "write_pages"]


def run_bench(options: BenchOptions, run_command: RunCommand, say: Say = print) -> "Pages":
    """Make every piece that has no record yet, with new pages after each; return the pages.

    run_command: runs a command of the program and returns whether it went well. say: hears of scenes that are
    not there, of pieces already made and of where the pages are. Raises `ConfigError` for options that make
    no sense and where no scene is found, `InputError` for maps that cannot be used, and `ResourceError` at
    the end if a piece failed.
    """
    pages = Pages(options, say)
    _check(options)
    benchmark = Benchmark(options, pages.records, run_command, say)
    found = _found(options.scenes, options.data, say)
    pieces = _pieces(benchmark, found, options.steps, options.paper_iterations)
    if not pieces:
        raise ConfigError(
            f"--steps {' '.join(options.steps)} has nothing to do: seeds need a second one of --seeds, losses the "
            f"scene {LOSSES_SCENE}, lessons another preset than paper."
        )
    benchmark.check(tuple(found), options.steps, options.paper_iterations)
    for piece in pieces:
        piece()
        pages.write(options.scenes)
    pages.name()
    if benchmark.failed:
        raise ResourceError(
            f"These pieces failed, their messages stand above: {', '.join(benchmark.failed)}."
        )
    return pages


def write_pages(options: BenchOptions, say: Say = print) -> "Pages":
    """Write the pages from the records alone and return them; raise `ConfigError` where there are none."""
    pages = Pages(options, say)
    if not pages.records.is_dir() or not read_records(pages.records):
        raise ConfigError(
            f"There is no record in {pages.records}; tell where the records are with --records DIR."
        )
    pages.write(())
    pages.name()
    return pages


def _pieces(
    benchmark: Benchmark, found: dict[str, Path], steps: Sequence[Step], paper_iterations: tuple[int, ...]
) -> list[Callable[[], None]]:
    """Return everything to do, the most wanted first."""
    own = (
        benchmark.preset is not Preset.PAPER
    )  # which has lessons of its own, and no other settings beside it
    pieces: list[Callable[[], None]] = []
    if Step.RUN in steps:
        pieces += [functools.partial(benchmark.scene, *scene) for scene in found.items()]
    if Step.PAPER in steps and paper_iterations and own:
        pieces += [functools.partial(benchmark.paper, *scene, *paper_iterations) for scene in found.items()]
    if Step.SEEDS in steps:
        pieces += [
            functools.partial(benchmark.seed, *scene, seed)
            for scene in found.items()
            for seed in benchmark.seeds[1:]
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

    def __init__(self, options: BenchOptions, say: Say):
        """Find the places: paper-tables.md goes beside a page that was named, else to docs/ if there is one."""
        usual = Path("benchmarks") if Path("benchmarks").is_dir() else options.output
        self.records, self.results = (
            options.records or usual / "records",
            options.results or usual / "RESULTS.md",
        )
        beside = options.results is not None or not Path("docs").is_dir()
        self.paper = (self.results.parent if beside else Path("docs")) / "paper-tables.md"
        self._say = say

    def write(self, scenes: Sequence[str]) -> None:
        """Write both pages; those of `scenes` that have no record are named."""
        found = read_records(self.records)
        scored = {record.scene for record in found if record.kind is Kind.RUN}
        missing = [f"{name}, for which there are no numbers." for name in scenes if name not in scored]
        everything = BenchResults(found, missing)
        write_bytes(self.results, results_page(everything).encode())
        write_bytes(self.paper, paper_page(everything).encode())

    def name(self) -> None:
        """Say where the pages are."""
        self._say(f"Results: {self.results}\nThe paper's tables: {self.paper}")


def _found(scenes: Sequence[str], data: Path, say: Say) -> dict[str, Path]:
    """Return the folders of the scenes that there are, and name the others; raise `ConfigError` for none."""
    found = {name: folder for name in scenes if (folder := find_scene(data, name)) is not None}
    for name in scenes:
        if name not in found:
            say(
                f"SKIPPED {name}: there is no scene of that name in {data}; tell where it is with --data DIR."
            )
    if not found:
        raise ConfigError(f"None of {', '.join(scenes)} is in {data}; tell where they are with --data DIR.")
    return found


def find_scene(data: Path, name: str) -> Path | None:
    """Return the folder of a scene in `data` or one folder down, or None."""
    places = [data / name, *sorted(folder / name for folder in data.glob("*") if folder.is_dir())]
    return next((place for place in places if place.is_dir()), None)


def _check(options: BenchOptions) -> None:
    """Raise now what would otherwise stop a piece hours later."""
    seeds, counts, steps = options.seeds, options.paper_iterations, options.steps
    if not seeds or len(set(seeds)) < len(seeds) or min(seeds) < 0:
        raise ConfigError("--seeds must be one number or more, none negative and none twice.")
    if counts and (len(counts) != 2 or min(counts) < 1):
        raise ConfigError(
            "--paper-iterations must be two numbers of 1 or more: steps of Phase I and of Phase II."
        )
    Protocols(slow_photos=options.slow_photos)
    own_paper = Step.PAPER in steps and set(steps) != set(Step)
    if options.preset is Preset.PAPER and (options.hdri is not None or counts or own_paper):
        given = "--hdri" if options.hdri is not None else "--paper-iterations" if counts else "--steps paper"
        raise ConfigError(f"{given} changes nothing with --preset paper, all of whose runs are the paper's.")
    if own_paper and not counts:
        raise ConfigError("--steps paper needs --paper-iterations I II; the paper's own are 40000 30000.")
    if options.hdri is not None:
        environment_files(options.hdri)

"""bench: every scene trained and evaluated, and the tables."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff

from lightprobe.cli import main
from lightprobe.cli.answer import keep, say
from lightprobe.cli.options import option
from lightprobe.core.config import Preset
from lightprobe.core.errors import INTERRUPTED
from lightprobe.report.records import read_records
from lightprobe.runs.bench import BenchOptions, Step, run_bench, write_pages

_USUAL = BenchOptions()

_ScenesArg = Annotated[tuple[str, ...], option(help="Names of scenes. kettle and figure are for releases.")]
_DataArg = Annotated[
    Path, option(metavar="DIR", help="Where the scenes' folders are, at most one folder down.")
]
_OutputArg = Annotated[Path, option(aliases=["-o"], metavar="FOLDER", help="Runs and variants.")]
_RunsArg = Annotated[
    Path | None, option(metavar="FOLDER", help="Finished runs named as the scenes, if not there.")
]
_PresetArg = Annotated[Preset, option(help="Size of the training.")]
_StepsArg = Annotated[
    tuple[Step, ...], option(help="What to do: runs, the paper's settings, other seeds, lessons, losses.")
]
_SeedsArg = Annotated[
    tuple[int, ...],
    option(help="The first is every run's; the others train the default and the losses again."),
]
_IterationsArg = Annotated[
    tuple[int, ...],
    option(
        metavar="I II",
        help="Steps of each pass of Phase I and of Phase II in runs with the paper's settings.",
    ),
]
_SlowArg = Annotated[int, option(help="Test photos for methods that take more than 20 s each.")]
_HdriArg = Annotated[
    Path | None,
    option(
        metavar="DIR",
        help="Folder of .exr or .hdr environments, z up: one more Phase II trains under them, too.",
    ),
]
_RecordsArg = Annotated[
    Path | None,
    option(metavar="DIR", help="Where records are kept; benchmarks/records, else FOLDER/records."),
]
_ResultsArg = Annotated[
    Path | None,
    option(metavar="RESULTS.md", help="The page; by default benchmarks/RESULTS.md, else in FOLDER."),
]
_TablesArg = Annotated[FlagCreatePairsOff[bool], option(help="Only write the pages from the records.")]


def bench(
    *,
    scenes: _ScenesArg = _USUAL.scenes,
    data: _DataArg = _USUAL.data,
    output: _OutputArg = _USUAL.output,
    runs: _RunsArg = None,
    preset: _PresetArg = _USUAL.preset,
    steps: _StepsArg = _USUAL.steps,
    seeds: _SeedsArg = _USUAL.seeds,
    paper_iterations: _IterationsArg = (),
    slow_photos: _SlowArg = _USUAL.slow_photos,
    hdri: _HdriArg = None,
    records: _RecordsArg = None,
    results: _ResultsArg = None,
    tables_only: _TablesArg = False,
) -> None:
    """Train and evaluate every scene with every method, and write the tables.

    Every finished evaluation leaves a small record, and the pages are written from the records alone: the
    same command goes on where an interrupted one stopped, on another day too. A record is made anew once its
    file is deleted. With --paper-iterations, the scenes are also trained with the paper's settings. Scenes
    that are not in DIR are left out and named. Beside RESULTS.md, or in docs/, paper-tables.md sets the
    paper's tables beside ours.

    Examples:
      lightprobe bench --data ~/light-data
      lightprobe bench --data ~/light-data --scenes spot --steps run seeds --runs runs
      lightprobe bench --data ~/light-data --scenes spot cape --steps paper --paper-iterations 1500 2000
      lightprobe bench --data ~/light-data --hdri ~/hdris
      lightprobe bench --tables-only
    """
    asked = BenchOptions(
        scenes,
        data,
        output,
        runs,
        preset,
        steps,
        seeds,
        paper_iterations,
        slow_photos,
        hdri,
        records,
        results,
    )
    pages = write_pages(asked, say) if tables_only else run_bench(asked, _run, say)
    means = {record.name: record.metrics["mean"] for record in read_records(pages.records)}
    keep(results=pages.results, paper_tables=pages.paper, records=pages.records, means=means)


def _run(command: Sequence[str]) -> bool:
    """Run a command of this program and return whether it went well; an interruption ends the benchmark, too."""
    say(f"lightprobe {' '.join(command)}")
    sys.stdout.flush()
    code = main.main(list(command))
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    return code == 0

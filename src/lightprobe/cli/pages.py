"""open, compare, gallery: pages about runs that were evaluated."""

import math
import os
import sys
import webbrowser
from pathlib import Path
from typing import Annotated

from rich.console import Console
from rich.table import Table
from tyro.conf import Positional

from lightprobe.cli.answer import is_for_programs, keep, say
from lightprobe.cli.options import RunArg, option
from lightprobe.report.comparison import SCORES, Comparison
from lightprobe.runs.pages import compare_runs, report_of, write_gallery

_OtherArg = Annotated[
    Positional[Path], option(metavar="OTHER", help="Run to compare with it, on the same scene.")
]
_PageArg = Annotated[Path, option(aliases=["-o"], metavar="PAGE.html", help="Page to write.")]
_RunsArg = Annotated[
    Positional[tuple[Path, ...]], option(metavar="RUN...", help="Evaluated runs (at least one).")
]
_FolderArg = Annotated[Path, option(aliases=["-o"], metavar="DIR", help="Folder for the pages.")]


def open_report(run: RunArg) -> None:
    """Show a run's report in the browser; where there is none, print where the report is.

    Examples:
      lightprobe open runs/cup
    """
    page = report_of(run)
    say(f"Report: {page}", report=page, opened=show_page(page))


def show_page(page: Path) -> bool:
    """Open a page in the browser and return whether there is one; a browser in the terminal would take it
    over.
    """
    if sys.platform not in ("darwin", "win32") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return False
    return webbrowser.open(page.resolve().as_uri())


def compare(run: RunArg, other: _OtherArg, *, output: _PageArg = Path("comparison.html")) -> None:
    """Set two evaluated runs beside each other: their test photos' pictures, and by how much the scores
    differ.

    Differences are OTHER less RUN, over the test photos that both have.

    Examples:
      lightprobe compare runs/cup runs/cup-longer
      lightprobe compare runs/cup runs/cup-longer -o cups.html
    """
    found = compare_runs(run, other, output)
    say(f"Page: {output}", page=output)
    keep(**found.to_json())
    if not is_for_programs():
        _print_differences(found)


def _print_differences(found: Comparison) -> None:
    """Print the means of the default methods and their differences."""
    table = Table("score", *found.names, "difference")
    for key, difference in found.differences().items():
        heading = SCORES[key]
        change = f"{difference.value:+.{heading.decimals}f}"
        if math.isfinite(difference.margin):
            change += f" ± {heading.text(difference.margin)}"
        table.add_row(heading.name, heading.text(difference.first), heading.text(difference.second), change)
    Console().print(table)


def gallery(runs: _RunsArg, *, output: _FolderArg) -> None:
    """Put many evaluated runs on one page, each with a picture, its scores and its report, ready for a web
    server.

    Examples:
      lightprobe gallery runs/* -o gallery
    """
    reports = write_gallery(runs, output)
    means = {name: report.metrics["mean"] for name, report in reports.items()}
    say(f"Runs: {len(reports)}, in {output / 'index.html'}", page=output / "index.html", means=means)

"""report: pages about runs that were evaluated."""

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
from lightprobe.cli.options import option
from lightprobe.core.errors import ConfigError
from lightprobe.report.comparison import SCORES, Comparison
from lightprobe.runs.pages import compare_runs, report_of, write_gallery

_RunsArg = Annotated[
    Positional[tuple[Path, ...]],
    option(metavar="RUN [OTHER ...]", help="Evaluated runs: one, two to compare, or many."),
]
_PageArg = Annotated[Path, option(aliases=["-o"], metavar="PAGE.html", help="Page to write of two runs.")]
_GalleryArg = Annotated[
    Path | None,
    option(metavar="FOLDER", help="Folder for a page of all runs with their reports, ready for the web."),
]


def report(
    runs: _RunsArg, *, output: _PageArg = Path("comparison.html"), gallery: _GalleryArg = None
) -> None:
    """Show a run's report, set two runs beside each other, or put many on one page.

    One run: its report is shown in the browser; where there is none, it is said where the report is. Two: a page with
    their test photos' pictures and by how much the scores differ, OTHER less RUN, over the test photos that both have.

    Examples:
      lightprobe report runs/cup
      lightprobe report runs/cup runs/cup-longer -o cups.html
      lightprobe report runs/* --gallery gallery
    """
    if gallery is not None:
        reports = write_gallery(runs, gallery)
        means = {name: each.metrics["mean"] for name, each in reports.items()}
        say(f"Runs: {len(reports)}, in {gallery / 'index.html'}", page=gallery / "index.html", means=means)
    elif len(runs) == 1:
        page = report_of(runs[0])
        say(f"Report: {page}", report=page, opened=_show_page(page))
    elif len(runs) == 2:
        found = compare_runs(*runs, output)
        say(f"Page: {output}", page=output)
        keep(**found.to_json())
        if not is_for_programs():
            _print_differences(found)
    else:
        raise ConfigError("Name one run to see its report, two to compare, or more with --gallery FOLDER.")


def _show_page(page: Path) -> bool:
    """Open a page in the browser and return whether there is one; one in the terminal would take it over."""
    screens = (os.environ.get("DISPLAY"), os.environ.get("WAYLAND_DISPLAY"))
    if sys.platform not in ("darwin", "win32") and not any(screens):
        return False
    return webbrowser.open(page.resolve().as_uri())


def _print_differences(found: Comparison) -> None:
    """Print the means of the default methods and their differences."""
    table = Table("score", *found.names, "difference")
    for key, d in found.differences().items():
        heading = SCORES[key]
        change = heading.signed(d.difference)
        change += f" ± {heading.text(d.interval)}" if math.isfinite(d.interval) else ""
        table.add_row(heading.name, heading.text(d.first), heading.text(d.second), change)
    Console().print(table)

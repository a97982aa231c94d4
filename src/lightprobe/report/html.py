"""Pages of HTML that need no other file: templates filled in by Jinja, which escapes what it is given.

Style and script (`assets/report`) stand in the page, pictures are data URIs; a page without its script still shows
everything. Here is what the templates share: tables with the best values in bold, the order of sections, links.
"""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from lightprobe.prediction.confidence import css_gradient, ticks
from lightprobe.report.headings import IMAGES, LIGHTS, Heading, Headings
from lightprobe.report.pictures import CONFIDENCE, OF_THE_LIGHT, OF_THE_VIEW, PICTURE_HINTS

if TYPE_CHECKING:
    import jinja2

Links = dict[str, Path]  # what a file is -> where it is
Rows = Mapping[str, Mapping[str, Any]]  # label -> score -> value

_ORDERED = ("psnr_masked", "psnr_unseen", "relit_psnr_scaled", "matte_si_rmse")
ORDERS: Headings = {key: heading for key, heading in (IMAGES | LIGHTS).items() if key in _ORDERED}
"""Scores that sections can be put in the order of."""


@dataclass(frozen=True)
class Cell:
    """A value in a table; its interval and a class of the style only where there is one."""

    value: float
    text: str
    margin: str = ""
    best: bool = False
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """A table whose columns sort; None stands where a row has no value."""

    corner: str
    columns: list[Heading]
    rows: dict[str, list[Cell | None]]
    anchors: Mapping[str, str]  # row -> id of the element that its label leads to


def fill(template: str, **content: Any) -> str:
    """Return a page: the template of this name filled in with its content."""
    return _environment().get_template(template).render(**content)


@cache
def _environment() -> "jinja2.Environment":
    import jinja2
    from markupsafe import Markup

    loader = jinja2.PackageLoader("lightprobe.report", "templates")
    found = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    assets = resources.files("lightprobe") / "assets" / "report"
    found.globals |= {
        "style": Markup((assets / "page.css").read_text("utf-8")),
        "script": Markup((assets / "page.js").read_text("utf-8")),
        "orders": ORDERS,
        "hints": PICTURE_HINTS,
        "confidence": CONFIDENCE,
        "gradient": css_gradient(),
        "ticks": ticks(),
        "of_the_view": OF_THE_VIEW,
        "light_titles": light_titles,
    }
    return found


def light_titles(pictures: Iterable[str]) -> list[str]:
    """Return the titles of the light's large pictures: the confidence stands where no true light can."""
    titles = [title for title in OF_THE_LIGHT if title in pictures]
    return titles if "true light" in titles else [*titles, *({CONFIDENCE} & {*pictures})]


def links(files: Links, folder: Path) -> dict[str, str]:
    """Return the address of each of the files that exist, relative to `folder`, by what the file is."""
    found = {name: Path(os.path.relpath(path, folder)) for name, path in files.items() if path.is_file()}
    return {name: quote(path.as_posix()) for name, path in found.items()}


def order_choices(scores: Iterable[Mapping[str, Any]]) -> Headings:
    """Return the scores that sections can be put in the order of: of `ORDERS`, what two sections or more have."""
    every = list(scores)
    return {key: heading for key, heading in ORDERS.items() if sum(key in each for each in every) > 1}


def table(
    corner: str,
    rows: Rows,
    headings: Headings,
    *,
    intervals: Rows | None = None,
    compared: Iterable[str] = (),
    anchors: Mapping[str, str] | None = None,
) -> Table:
    """Return a table with the columns that any row has.

    A known interval stands behind its value. `compared` are the rows whose best values are bold. `anchors` leads
    from a row's label to an element of the page.
    """
    used = {key: heading for key, heading in headings.items() if any(key in row for row in rows.values())}
    best = best_cells({name: rows[name] for name in compared if name in rows}, used)

    def cell(name: str, key: str) -> Cell | None:
        if key not in rows[name]:
            return None
        heading, value, margins = used[key], rows[name][key], (intervals or {}).get(name, {})
        margin = heading.text(margins[key]) if key in margins else ""
        return Cell(value, heading.text(value), margin, (name, key) in best)

    cells = {name: [cell(name, key) for key in used] for name in rows}
    return Table(corner, list(used.values()), cells, anchors or {})


def best_cells(rows: Rows, headings: Headings) -> set[tuple[str, str]]:
    """Return (row, score) of the best values among two rows or more; values that look alike are equally good."""
    best = set()
    for key, heading in headings.items():
        shown = {name: float(heading.text(scores[key])) for name, scores in rows.items() if key in scores}
        if heading.more_is_better is None or len(shown) < 2:
            continue
        top = (max if heading.more_is_better else min)(shown.values())
        best |= {(name, key) for name, value in shown.items() if value == top}
    return best

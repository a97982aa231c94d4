"""Two runs on one page: the photos that both were tested on, side by side, and by how much their scores
differ.

Differences are the second run's score less the first one's, each with the 95 % interval of the mean over
photos, which are paired: what makes a photo hard for both runs cancels.
"""

import html
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.evaluation.metrics import photo_interval
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, Heading
from lightprobe.report.page import facts_line, figure, web_page
from lightprobe.report.photo_section import ORDERS, anchor, order_list, score_attributes
from lightprobe.report.report import Report, evenly_spaced
from lightprobe.report.report_tables import headline, label

SCORES = IMAGES | LIGHTS | MAPS


@dataclass(frozen=True)
class Difference:
    """One score of both runs: means over the photos that both have it of."""

    first: float
    second: float
    margin: float  # half the 95 % interval of the mean difference; nan for too few photos
    photos: int

    @property
    def value(self) -> float:
        """The second run's mean less the first one's."""
        return self.second - self.first

    def is_clear(self) -> bool:
        """Return whether the interval of the difference leaves zero out."""
        return math.isfinite(self.margin) and abs(self.value) > self.margin


@dataclass(frozen=True)
class Comparison:
    """Two evaluated runs under the names that the page gives them."""

    names: tuple[str, str]
    reports: tuple[Report, Report]

    def __post_init__(self) -> None:
        """Raise `InputError` when no photo was tested by both."""
        if not self.photos:
            raise InputError(
                f"{self.names[0]} and {self.names[1]} have no test photo in common: nothing to compare."
            )

    @cached_property
    def photos(self) -> list[str]:
        """The test photos that both runs have, in the order of the first."""
        first, second = (report.metrics["photos"] for report in self.reports)
        return [name for name in first if name in second]

    def methods(self) -> list[tuple[str, str]]:
        """Return the methods that are compared: the defaults of both with each other, then those that both
        scored.
        """
        first, second = (report.metrics for report in self.reports)
        default = (first["default_method"], second["default_method"])
        same = [(method, method) for method in first["methods"] if method in second["methods"]]
        return [default, *(pair for pair in same if pair != default)]

    def differences(self, methods: tuple[str, str] | None = None) -> dict[str, Difference]:
        """Return score -> difference of two methods, by default of the runs' default ones."""
        found = {}
        for key in SCORES:
            pairs = {photo: self.pair(photo, key, methods or self.methods()[0]) for photo in self.photos}
            known = {photo: pair for photo, pair in pairs.items() if pair is not None}
            if known:
                first, second = (sum(pair[i] for pair in known.values()) / len(known) for i in (0, 1))
                margin = photo_interval({photo: b - a for photo, (a, b) in known.items()}, self._lights())
                found[key] = Difference(first, second, margin, len(known))
        return found

    def pair(self, photo: str, key: str, methods: tuple[str, str]) -> tuple[float, float] | None:
        """Return a photo's score with both runs, or None where one does not have it."""
        values = []
        for report, method in zip(self.reports, methods, strict=True):
            scores = report.metrics["photos"][photo]
            values.append(
                scores.get("methods", {}).get(method, scores if self._is_default(report, method) else {})
            )
        a, b = (scores.get(key) for scores in values)
        return None if a is None or b is None else (a, b)

    def to_json(self) -> dict[str, Any]:
        """Return the differences of all methods as JSON."""
        return {
            "runs": list(self.names),
            "photos": self.photos,
            "methods": [
                {
                    "methods": list(methods),
                    "scores": {
                        key: {
                            "first": d.first,
                            "second": d.second,
                            "difference": d.value,
                            "interval": d.margin,
                            "photos": d.photos,
                        }
                        for key, d in self.differences(methods).items()
                    },
                }
                for methods in self.methods()
            ],
        }

    def _lights(self) -> dict[str, str]:
        photos = self.reports[0].metrics["photos"]
        return {
            name: photos[name]["light"] for name in self.photos if isinstance(photos[name].get("light"), str)
        }

    @staticmethod
    def _is_default(report: Report, method: str) -> bool:
        return bool(report.metrics["default_method"] == method)


def comparison_page(found: Comparison) -> str:
    """Return the page of two runs as HTML: pictures, then the differences in tables."""
    title = f"{found.names[0]} against {found.names[1]}"
    return web_page(
        title,
        [
            f"<h1>{html.escape(title)}</h1>",
            *(facts_line({name: "", **report.facts}, []) for name, report in _named(found)),
            "<h2>Test photos of both</h2>",
            *_sections(found),
            '<h2 id="numbers">Differences</h2>',
            f"<p>Means over the {len(found.photos)} test photos that both runs have; differences are "
            f"{html.escape(found.names[1])} less {html.escape(found.names[0])}, ± the half width of their 95 % "
            "interval over photos. Green is better and red worse, where the interval leaves zero out.</p>",
            *(_method_table(found, methods) for methods in found.methods()),
            "<h2>Photo by photo</h2>",
            _photo_table(found),
        ],
    )


def _named(found: Comparison) -> list[tuple[str, Report]]:
    return list(zip(found.names, found.reports, strict=True))


def _sections(found: Comparison) -> list[str]:
    """Return a section for each photo that both runs have pictures of, and the list that puts them in order."""
    places = _places(found)
    changes = {name: _changes(found, name) for name in places}
    sections = [_section(found, name, place, changes[name]) for name, place in places.items()]
    order = order_list("photos", list(changes.values()), "change of ")
    return [order, f'<div id="photos">{"".join(sections)}</div>']


def _places(found: Comparison) -> dict[str, int]:
    """Return the photos that have a section, with their places among all."""
    first, second = (report.pictures for report in found.reports)
    shown = evenly_spaced([name for name in found.photos if name in first])
    return {name: found.photos.index(name) for name in shown if name in second}


def _changes(found: Comparison, photo: str) -> dict[str, float]:
    pairs = {key: found.pair(photo, key, found.methods()[0]) for key in ORDERS}
    return {key: pair[1] - pair[0] for key, pair in pairs.items() if pair is not None}


def _section(found: Comparison, name: str, place: int, changes: dict[str, float]) -> str:
    words = [f"{ORDERS[key].name} {_signed(ORDERS[key], change)}" for key, change in changes.items()]
    header = f"<header><b>{html.escape(name)}</b><span>{html.escape(' · '.join(words))}</span><span></span></header>"
    truth = found.reports[0].pictures[name]
    rows = (
        ("photo", "render"),
        ("true light", "predicted light"),
        ("spheres, true light", "spheres, predicted light"),
    )
    cells = []
    for true, mine in rows:
        true_cell = figure(true, truth[true]) if true in truth else "<figure></figure>"
        others = [
            figure(mine, report.pictures[name][mine], f"{mine}: {run}")
            for run, report in _named(found)
            if mine in report.pictures[name]
        ]
        cells += [true_cell, *others] if len(others) == 2 else []
    grid = f'<div class="pairs">{"".join(cells)}</div>'
    return f'<section id="{anchor(place)}" data-place="{place}"{score_attributes(changes)}>{header}{grid}</section>'


def _method_table(found: Comparison, methods: tuple[str, str]) -> str:
    title = methods[0] if methods[0] == methods[1] else f"{methods[0]} against {methods[1]}"
    lines = []
    for key, difference in found.differences(methods).items():
        heading = SCORES[key]
        margin = (
            f"<small> ± {heading.text(difference.margin)}</small>" if math.isfinite(difference.margin) else ""
        )
        values = (difference.first, difference.second)
        cells = "".join(f'<td data-value="{v:.6g}">{heading.text(v)}</td>' for v in values)
        lines.append(
            f"<tr><td>{headline(heading)}</td>{cells}"
            f'<td{_class(heading, difference)} data-value="{difference.value:.6g}">'
            f"{_signed(heading, difference.value)}{margin}</td>"
            f'<td class="note">{html.escape(heading.note)}</td></tr>'
        )
    names = "".join(f"<th>{html.escape(name)}</th>" for name in found.names)
    head = f"<thead><tr><th>score</th>{names}<th>difference</th><th></th></tr></thead>"
    body = f"{head}<tbody>{''.join(lines)}</tbody>"
    return f'<h3>{html.escape(title)}</h3><div class="scroll"><table>{body}</table></div>'


def _photo_table(found: Comparison) -> str:
    methods = found.methods()[0]
    keys = [key for key in SCORES if any(found.pair(photo, key, methods) for photo in found.photos)]
    anchors = {photo: anchor(place) for photo, place in _places(found).items()}
    lines = []
    for photo in found.photos:
        cells = ""
        for key in keys:
            pair = found.pair(photo, key, methods)
            change = None if pair is None else pair[1] - pair[0]
            cells += (
                "<td>–</td>"
                if change is None
                else (f'<td data-value="{change:.6g}">{_signed(SCORES[key], change)}</td>')
            )
        lines.append(f"<tr><td>{label(photo, anchors)}</td>{cells}</tr>")
    head = "".join(f"<th>{headline(SCORES[key])}</th>" for key in keys)
    body = f"<thead><tr><th>photo</th>{head}</tr></thead><tbody>{''.join(lines)}</tbody>"
    return f'<div class="scroll"><table>{body}</table></div>'


def _signed(heading: Heading, value: float) -> str:
    return f"{value:+.{heading.decimals}f}"


def _class(heading: Heading, difference: Difference) -> str:
    if heading.more_is_better is None or not difference.is_clear():
        return ""
    return ' class="better"' if (difference.value > 0) is heading.more_is_better else ' class="worse"'

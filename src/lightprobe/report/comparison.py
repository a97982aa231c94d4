"""Two runs on one page: the photos that both were tested on, side by side, and by how much their scores differ.

Differences are the second run's score less the first one's, each with the 95 % interval of the mean over photos, which
are paired: what makes a photo hard for both runs cancels.
"""

import math
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.evaluation.metrics import photo_interval
from lightprobe.report import html
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, Heading
from lightprobe.report.html import ORDERS, Cell
from lightprobe.report.report import Report, evenly_spaced

SCORES = IMAGES | LIGHTS | MAPS
_PAIRS = (
    ("photo", "render"),
    ("true light", "predicted light"),
    ("spheres, true light", "spheres, predicted light"),
)
"""Pictures of the truth, and what both runs make of it."""


@dataclass(frozen=True)
class Difference:
    """One score of both runs: means over the photos for which both runs have the score."""

    first: float
    second: float
    difference: float  # of the second run's mean less the first one's
    interval: float  # half the 95 % interval of the mean difference; nan for too few photos
    photos: int

    def is_clear(self) -> bool:
        """Return whether the interval of the difference leaves zero out."""
        return math.isfinite(self.interval) and abs(self.difference) > self.interval


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

    @property
    def runs(self) -> list[tuple[str, Report]]:
        """Names and reports."""
        return list(zip(self.names, self.reports, strict=True))

    @cached_property
    def photos(self) -> list[str]:
        """The test photos that both runs have, in the order of the first."""
        first, second = (report.metrics["photos"] for report in self.reports)
        return [name for name in first if name in second]

    def methods(self) -> list[tuple[str, str]]:
        """Return what is compared: the default methods of both with each other, then methods that both scored."""
        first, second = (report.metrics for report in self.reports)
        default = (first["default_method"], second["default_method"])
        same = [(method, method) for method in first["methods"] if method in second["methods"]]
        return [default, *(pair for pair in same if pair != default)]

    def differences(self, methods: tuple[str, str] | None = None) -> dict[str, Difference]:
        """Return score -> difference of two methods, by default of the runs' default ones."""
        photos, found = self.reports[0].metrics["photos"], {}
        lights = {
            name: photos[name]["light"] for name in self.photos if isinstance(photos[name].get("light"), str)
        }
        for key in SCORES:
            pairs = {photo: self.pair(photo, key, methods or self.methods()[0]) for photo in self.photos}
            known = {photo: pair for photo, pair in pairs.items() if pair is not None}
            if known:
                first, second = (sum(pair[i] for pair in known.values()) / len(known) for i in (0, 1))
                interval = photo_interval({photo: b - a for photo, (a, b) in known.items()}, lights)
                found[key] = Difference(first, second, second - first, interval, len(known))
        return found

    def pair(self, photo: str, key: str, methods: tuple[str, str]) -> tuple[float, float] | None:
        """Return a photo's score with both runs, or None where one does not have it."""
        values = []
        for report, method in zip(self.reports, methods, strict=True):
            scores = report.metrics["photos"][photo]
            own = scores if report.metrics["default_method"] == method else {}
            values.append(scores.get("methods", {}).get(method, own).get(key))
        return None if values[0] is None or values[1] is None else (values[0], values[1])

    def to_json(self) -> dict[str, Any]:
        """Return the differences of all methods as JSON."""
        every = [
            {"methods": list(m), "scores": {key: asdict(d) for key, d in self.differences(m).items()}}
            for m in self.methods()
        ]
        return {"runs": list(self.names), "photos": self.photos, "methods": every}


def comparison_page(found: Comparison) -> str:
    """Return the page of two runs as HTML: pictures, then the differences in tables."""
    methods = found.methods()[0]
    changes = {
        photo: {
            key: pair[1] - pair[0] for key in SCORES if (pair := found.pair(photo, key, methods)) is not None
        }
        for photo in found.photos
    }
    first, second = (report.pictures for report in found.reports)
    shown = [
        name for name in evenly_spaced([name for name in found.photos if name in first]) if name in second
    ]
    places = {name: found.photos.index(name) for name in shown}
    photos = [
        {
            "name": name,
            "place": place,
            "changes": {key: changes[name][key] for key in ORDERS if key in changes[name]},
            "first": first[name],
            "second": second[name],
        }
        for name, place in places.items()
    ]
    every = html.table(
        "photo", changes, SCORES, anchors={name: f"photo-{place}" for name, place in places.items()}
    )
    for photo, cells in every.rows.items():
        signed = [c and Cell(c.value, h.signed(c.value)) for c, h in zip(cells, every.columns, strict=True)]
        every.rows[photo] = signed
    return html.fill(
        "comparison.html",
        title=f"{found.names[0]} against {found.names[1]}",
        found=found,
        photos=photos,
        pairs=_PAIRS,
        choices=html.order_choices(changes[name] for name in shown),
        methods=[(pair, _score_rows(found.differences(pair))) for pair in found.methods()],
        every_photo=every,
    )


def _score_rows(differences: dict[str, Difference]) -> list[tuple[Heading, list[Cell]]]:
    """Return each score with its cells: both runs, and the difference, which has a colour where it is clear."""
    rows = []
    for key, d in differences.items():
        heading, kind = SCORES[key], ""
        if heading.more_is_better is not None and d.is_clear():
            kind = "better" if (d.difference > 0) is heading.more_is_better else "worse"
        margin = heading.text(d.interval) if math.isfinite(d.interval) else ""
        values = [Cell(value, heading.text(value)) for value in (d.first, d.second)]
        rows.append((heading, [*values, Cell(d.difference, heading.signed(d.difference), margin, kind=kind)]))
    return rows

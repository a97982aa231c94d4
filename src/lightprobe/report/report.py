"""The evaluation as one web page, pictures of every test photo and then tables; and what it was made from, stored.

    RUN/report/index.html   the page; its links lead to files of the run, relative to it, while it stays where it is
    RUN/report/page.json    {"title", "facts", "commands", "pictures": photo -> title -> data URI of a JPEG}
    RUN/metrics.json        the scores

Other pages show the run from the last two without predicting again. A run may come from elsewhere, so what goes into
a page is checked.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.core.files import write_bytes, write_json
from lightprobe.core.run import RunFolder
from lightprobe.core.stored import checked_object, damaged, is_finite_number, read_object
from lightprobe.report import html
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT, Heading, Headings
from lightprobe.report.html import Links, Table, table
from lightprobe.report.pictures import PICTURE_NOTES

MAX_ROWS = 32  # photos with pictures; the table has all of them
_REMEDY = "make it anew with: lightprobe eval RUN"
_JPEG = re.compile(r"data:image/jpeg;base64,[A-Za-z0-9+/]+={0,2}")
_STORED = ("title", "facts", "commands", "pictures")


@dataclass(frozen=True)
class Report:
    """What the page shows."""

    title: str
    metrics: dict[str, Any]  # the content of metrics.json
    pictures: dict[str, dict[str, str]] = field(default_factory=dict)  # photo -> title -> data URI
    facts: dict[str, str] = field(default_factory=dict)  # about the object and the run, by heading
    commands: Sequence[str] = ()  # that make these numbers again
    files: Links = field(default_factory=dict)  # of the run as a whole
    photo_files: dict[str, Links] = field(default_factory=dict)  # photo -> its files


def write_report(path: Path, report: Report) -> None:
    """Write the page at `path`, atomically; the page links to those of the report's files that exist."""
    write_bytes(path, report_page(report, path.parent).encode())


def report_page(report: Report, folder: Path) -> str:
    """Return the page as HTML with links relative to `folder`: the pictures first, then the numbers."""
    metrics, photos = report.metrics, report.metrics["photos"]
    shown = {title for pictures in report.pictures.values() for title in pictures}
    return html.fill(
        "report.html",
        title=report.title,
        report=report,
        metrics=metrics,
        files=html.links(report.files, folder),
        photos=[
            {
                "name": name,
                "pictures": pictures,
                "scores": photos[name],
                "files": html.links(report.photo_files.get(name, {}), folder),
            }
            for name, pictures in report.pictures.items()
        ],
        choices=html.order_choices(photos[name] for name in report.pictures),
        notes=[(title, note) for title, note in PICTURE_NOTES.items() if title in shown],
        images=_by_method(metrics, IMAGES),
        lights=_by_method(metrics, LIGHTS) if _knows_lights(metrics) else None,
        maps=_by_method(metrics, MAPS),
        by_confidence=_by_confidence(metrics),
        object=[(h, metrics["mean"][key]) for key, h in OBJECT.items() if key in metrics["mean"]],
        every_photo=table("photo", photos, IMAGES | LIGHTS | MAPS, anchors=anchors(report.pictures)),
        verdicts=metrics.get("verdicts", {}) if metrics.get("verdicts", {}).get("photos") else None,
        skipped=metrics.get("skipped", {}),
    )


def anchors(photos: Sequence[str] | Mapping[str, Any]) -> dict[str, str]:
    """Return the id of the section of each photo."""
    return {name: f"photo-{place}" for place, name in enumerate(photos)}


def evenly_spaced(names: Sequence[str], limit: int = MAX_ROWS) -> list[str]:
    """Return at most `limit` of `names`, evenly spread."""
    if len(names) <= limit:
        return list(names)
    return [names[i * len(names) // limit] for i in range(limit)]


def _by_method(metrics: dict[str, Any], headings: Headings) -> Table:
    """Return a table of the methods' means.

    A slow method may have seen only some of the photos; its mean is of other photos, so its row says how many they
    are, has no interval and is never the best one.
    """
    seen = [photo.get("methods", metrics["methods"]) for photo in metrics["photos"].values()]
    rows, intervals = {}, {}
    for method, scores in metrics["methods"].items():
        count = sum(method in each for each in seen)
        if count < len(seen):
            rows[f"{method} ({count} photo{'' if count == 1 else 's'})"] = scores
        else:
            rows[method], intervals[method] = scores, metrics.get("interval", {}).get(method, {})
    return table("method", rows, headings, intervals=intervals, compared=intervals)


def _knows_lights(metrics: dict[str, Any]) -> bool:
    return any(name in scores for scores in metrics["methods"].values() for name in LIGHTS | MAPS)


def _by_confidence(metrics: dict[str, Any]) -> Table:
    rows = {
        method: {f"e{i}": part["log_rmse_scaled"] for i, part in enumerate(checked["bins"])}
        | {f"c{i}": part["confidence"] for i, part in enumerate(checked["bins"])}
        for method, checked in metrics.get("confidence", {}).items()
    }
    columns = {f"e{i}": Heading(f"fifth {i + 1}", 2, "log-RMSE after one factor", False) for i in range(5)}
    columns |= {f"c{i}": Heading(f"confidence {i + 1}", 2, "mean confidence") for i in range(5)}
    return table("method", rows, columns)


def page_record(page: Path) -> Path:
    """Return where what a page was made from is kept."""
    return page.parent / "page.json"


def store_report(page: Path, report: Report) -> None:
    """Write what the report at `page` shows beside its numbers, as `read_report` reads it."""
    write_json(page_record(page), {key: getattr(report, key) for key in _STORED})


def read_report(run: RunFolder) -> Report:
    """Return the report of an evaluated run, without its links.

    Raises `InputError` for a run that was not evaluated, or was by a version that kept no pictures, and for damage.
    """
    page = page_record(run.report_file)
    for path in (run.metrics_file, page):
        if not path.is_file():
            raise InputError(f"{run.path} has no {path.name} of an evaluation; {_REMEDY}.")
    metrics, stored = _checked_metrics(run.metrics_file), read_object(page, _REMEDY)
    pictures, facts = (checked_object(stored.get(key), page, _REMEDY, key) for key in ("pictures", "facts"))
    for photo, each in pictures.items():
        for title, uri in checked_object(each, page, _REMEDY, photo).items():
            if not isinstance(uri, str) or not _JPEG.fullmatch(uri):
                raise damaged(page, f"'{title}' is no picture", _REMEDY)
    commands = stored.get("commands")
    if not isinstance(commands, list):
        raise damaged(page, "'commands' is no list", _REMEDY)
    for text in (stored.get("title"), *facts.values(), *commands):
        if not isinstance(text, str):
            raise damaged(page, "'title', 'facts' or 'commands' hold something else than text", _REMEDY)
    known = {photo: each for photo, each in pictures.items() if photo in metrics["photos"]}
    return Report(stored["title"], metrics, known, facts, commands)


def _checked_metrics(path: Path) -> dict[str, Any]:
    """Return the content of a metrics.json that pages can be made from."""

    def numbers(value: Any, key: str, names: Sequence[str] | None = None) -> dict[str, Any]:
        """Return an object; raise `InputError` unless its values, or those of `names`, are finite numbers."""
        found = checked_object(value, path, _REMEDY, key)
        for name, number in found.items():
            if (names is None or name in names) and not is_finite_number(number):
                raise damaged(path, f"'{name}' of '{key}' is no number", _REMEDY)
        return found

    def objects(value: Any, key: str) -> dict[str, Any]:
        return checked_object(value, path, _REMEDY, key)

    metrics = read_object(path, _REMEDY)
    mean = numbers(metrics.get("mean"), "mean")
    methods = objects(metrics.get("methods"), "methods")
    intervals = objects(metrics.setdefault("interval", {}), "interval")
    for name, scores in (*methods.items(), *intervals.items()):
        numbers(scores, name)
    for photo, scores in objects(metrics.get("photos"), "photos").items():
        numbers(scores, photo, list(mean))
        for method, each in objects(scores.get("methods", {}), photo).items():
            numbers(each, method)
    for method, checked in objects(metrics.setdefault("confidence", {}), "confidence").items():
        bins = objects(checked, method).get("bins")
        if not isinstance(bins, list):
            raise damaged(path, "'bins' is no list", _REMEDY)
        for part in bins:
            numbers(part, "bins")
    default = metrics.get("default_method")
    if not isinstance(default, str) or default not in methods:
        raise damaged(path, "'default_method' is none of its methods", _REMEDY)
    return metrics

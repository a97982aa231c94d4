"""The evaluation as one web page that needs no other file: pictures of every test photo, then tables.

Its links lead to the files of the run, relative to the page, for as long as it stays where it was written.
"""

import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lightprobe.core.files import write_bytes
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT, Heading
from lightprobe.report.page import Links, facts_line, links, web_page
from lightprobe.report.photo_section import anchor, order_list, photo_section
from lightprobe.report.pictures import PICTURE_NOTES
from lightprobe.report.report_tables import Rows, folded, score_list, table

MAX_ROWS = 32  # photos with pictures; the table has all of them


@dataclass(frozen=True)
class Report:
    """What the page shows."""

    title: str
    metrics: dict[str, Any]  # the content of metrics.json
    pictures: dict[str, dict[str, str]] = field(default_factory=dict)  # photo -> title -> data URI
    facts: dict[str, str] = field(default_factory=dict)  # about the object and the run, by heading
    commands: Sequence[str] = ()  # that make these numbers again
    files: Links = field(default_factory=dict)  # of the run as a whole
    photo_files: dict[str, Links] = field(default_factory=dict)  # photo -> the same


def write_report(path: Path, report: Report) -> None:
    """Write the page at `path`, atomically; it links to those of the report's files that exist."""
    write_bytes(path, report_page(report, path.parent).encode())


def report_page(report: Report, folder: Path) -> str:
    """Return the page as HTML with links relative to `folder`: the pictures first, then the numbers."""
    metrics = report.metrics
    return web_page(
        report.title,
        [
            f"<h1>{html.escape(report.title)}</h1>",
            facts_line(report.facts, links(report.files, folder)),
            _commands(report.commands),
            *_photos(report, folder),
            '<h2 id="numbers">Light from a single photo, by method</h2>',
            f"<p>The light is predicted from each test photo, the object re-rendered with it and compared with the "
            f"photo. Means over {len(metrics['photos'])} test photos, ± the half width of their 95 % interval, for "
            "which photos under one light count once. The pictures and the table of every photo belong to "
            f"<b>{html.escape(metrics['default_method'])}</b>.</p>",
            "<p>↑ more is better, ↓ less is better; the best value of a column is bold. A click on a heading "
            "sorts.</p>",
            _by_method(metrics, IMAGES),
            *_light_tables(metrics),
            *_object_scores(metrics),
            '<h2 id="every-photo">Every photo</h2>',
            table("photo", metrics["photos"], IMAGES | LIGHTS | MAPS, anchors=_anchors(report)),
            *_verdicts(metrics),
        ],
    )


def evenly_spaced(names: Sequence[str], limit: int = MAX_ROWS) -> list[str]:
    """Return at most `limit` of `names`, evenly spread."""
    if len(names) <= limit:
        return list(names)
    return [names[i * len(names) // limit] for i in range(limit)]


def _photos(report: Report, folder: Path) -> list[str]:
    """Return a section for each photo that has pictures, and the list that puts them in order."""
    if not report.pictures:
        return []
    photos = report.metrics["photos"]
    sections = [
        photo_section(name, place, pictures, photos[name], links(report.photo_files.get(name, {}), folder))
        for place, (name, pictures) in enumerate(report.pictures.items())
    ]
    shown = {title for pictures in report.pictures.values() for title in pictures}
    notes = ((title, note) for title, note in PICTURE_NOTES.items() if title in shown)
    return [
        "<h2>Test photos</h2><p>Never seen in training: the photo, the object under the light predicted from it, and "
        'that light. Numbers: <a href="#numbers">by method</a>, <a href="#every-photo">photo by photo</a>.</p>',
        order_list("photos", [photos[name] for name in report.pictures]),
        f'<div id="photos">{"".join(sections)}</div>',
        folded("What the pictures show", notes),
    ]


def _anchors(report: Report) -> dict[str, str]:
    return {name: anchor(place) for place, name in enumerate(report.pictures)}


def _verdicts(metrics: dict[str, Any]) -> list[str]:
    """Return what is wrong with photos: those that no light explains well, and those that are not scored."""
    doubts = {
        name: verdict["sentences"] for name, verdict in metrics.get("verdicts", {}).get("photos", {}).items()
    }
    told = {name: " ".join(sentences) for name, sentences in doubts.items() if sentences}
    parts = []
    if doubts:
        count = metrics["verdicts"]["doubtful"]
        parts += ['<h2 id="verdicts">Verdicts</h2>', f"<p>Doubtful: {count} of {len(doubts)} photos.</p>"]
        parts.append(_sentences(told))
    if skipped := metrics.get("skipped", {}):
        parts += ["<h2>Not scored</h2>", _sentences(skipped)]
    return parts


def _sentences(by_photo: dict[str, str]) -> str:
    items = (f"<li><b>{html.escape(name)}</b>: {html.escape(text)}</li>" for name, text in by_photo.items())
    return f"<ul>{''.join(items)}</ul>" if by_photo else ""


def _object_scores(metrics: dict[str, Any]) -> list[str]:
    if not any(name in metrics["mean"] for name in OBJECT):
        return []
    return ["<h2>The object against ground truth</h2>", score_list(metrics["mean"], OBJECT)]


def _commands(commands: Sequence[str]) -> str:
    if not commands:
        return ""
    lines = html.escape("\n".join(commands))
    return f"<details><summary>Commands that make these numbers again</summary><code>{lines}</code></details>"


def _by_method(metrics: dict[str, Any], headings: dict[str, Heading]) -> str:
    """Return a table of the methods' means.

    A slow method may have seen only some of the photos; its mean is of other photos, so its row says how many
    they are, has no interval and is never the best one.
    """
    seen = [photo.get("methods", metrics["methods"]) for photo in metrics["photos"].values()]
    counts = {method: sum(method in scores for scores in seen) for method in metrics["methods"]}
    labels = {
        method: method if count == len(seen) else f"{method} ({count} photo{'' if count == 1 else 's'})"
        for method, count in counts.items()
    }
    rows: Rows = {labels[method]: scores for method, scores in metrics["methods"].items()}
    compared = [labels[method] for method, count in counts.items() if count == len(seen)]
    known: Rows = {labels[method]: interval for method, interval in metrics.get("interval", {}).items()}
    intervals = {label: interval for label, interval in known.items() if label in compared}
    return table("method", rows, headings, intervals=intervals, compared=compared)


def _light_tables(metrics: dict[str, Any]) -> list[str]:
    """Return the scores of the lights and the error by confidence, or nothing where the true lights are
    unknown.
    """
    if not any(name in scores for scores in metrics["methods"].values() for name in LIGHTS | MAPS):
        return []
    body = ["<h3>Against the true lights: what they make of objects</h3>", _by_method(metrics, LIGHTS)]
    body += ["<h3>Against the true lights: the maps</h3>", _by_method(metrics, MAPS)]
    rows: Rows = {
        method: {f"e{i}": part["log_rmse_scaled"] for i, part in enumerate(checked["bins"])}
        | {f"c{i}": part["confidence"] for i, part in enumerate(checked["bins"])}
        for method, checked in metrics.get("confidence", {}).items()
    }
    columns = {f"e{i}": Heading(f"fifth {i + 1}", 2, "log-RMSE after one factor", False) for i in range(5)}
    columns |= {f"c{i}": Heading(f"confidence {i + 1}", 2, "mean confidence") for i in range(5)}
    return [
        *body,
        "<h3>Error by confidence</h3>",
        "<p>All directions of all photos in five parts of equal solid angle, the least confident first: the log-RMSE "
        "of each after one factor, and its mean confidence. Each method is divided by its own confidence, which is "
        "good where the error falls from left to right.</p>",
        table("method", rows, columns, legend=False),
    ]

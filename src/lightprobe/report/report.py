"""The evaluation as one web page that needs no other file: tables, and rows of pictures per test photo.

Its links lead to the files of the run, relative to the page, for as long as it stays where it was written.
"""

import html
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from lightprobe.core.files import write_bytes
from lightprobe.report.color_scale import css_gradient, ticks
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT, Heading
from lightprobe.report.pictures import CONFIDENCE, PICTURE_HINTS, PICTURE_NOTES
from lightprobe.report.report_tables import Rows, folded, score_list, table

MAX_ROWS = 32  # photos with pictures; the table has all of them

_STYLE = """
:root { color-scheme: light dark; --line: #d8d8d4; --soft: #6b6b66; --back: #fbfbf9; --text: #1d1d1b; --card: #ffffff; }
@media (prefers-color-scheme: dark) {
  :root { --line: #34353a; --soft: #9a9ba3; --back: #16171a; --text: #e8e8e6; --card: #1e1f23; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1500px; padding: 2.5rem 1.5rem 4rem; background: var(--back); color: var(--text);
  font: 15px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.6rem; margin: 0 0 .2rem; } h2 { font-size: 1.1rem; margin: 2.4rem 0 .6rem; }
h3 { font-size: .95rem; margin: 1.4rem 0 .4rem; } small { color: var(--soft); font-weight: normal; }
p { color: var(--soft); margin: .2rem 0 1rem; max-width: 75ch; } p.run { margin-bottom: .2rem; max-width: none; }
a { color: inherit; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .35rem .9rem .35rem 0; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th { font-weight: 600; } th:first-child, td:first-child { text-align: left; }
td b { font-weight: 700; } td.note { color: var(--soft); text-align: left; font-size: .85rem; }
.arrow { color: var(--soft); font-weight: normal; }
details { color: var(--soft); font-size: .85rem; margin: .5rem 0 1rem; } summary { cursor: pointer; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1.2rem; margin: .5rem 0; }
dt { color: var(--text); } dd { margin: 0; max-width: 75ch; }
code { display: block; overflow-x: auto; white-space: pre; font-size: .8rem; line-height: 1.6; }
section { background: var(--card); border: 1px solid var(--line); border-radius: 10px;
  padding: .9rem 1rem; margin: 1rem 0; }
section header { display: flex; flex-wrap: wrap; gap: .3rem 1.2rem; align-items: baseline; margin-bottom: .6rem; }
section header span { color: var(--soft); } section header span:last-child { margin-left: auto; font-size: .85rem; }
.row { display: grid; gap: .7rem; grid-template-columns: repeat(auto-fill, minmax(150px, 1fr)); margin-bottom: .7rem; }
.row.maps { grid-template-columns: repeat(auto-fill, minmax(235px, 1fr)); margin-bottom: 0; }
figure { margin: 0; }
figure img { width: 100%; display: block; border-radius: 5px; border: 1px solid var(--line); }
figcaption { color: var(--soft); font-size: .8rem; margin-top: .2rem; }
.scale { height: .5rem; border-radius: 2px; margin-top: .35rem; }
.ticks { position: relative; height: 2.5em; font-size: .7rem; line-height: 1.25; color: var(--soft); }
.ticks span { position: absolute; transform: translateX(-50%); text-align: center; white-space: nowrap; }
.ticks span:first-child { transform: none; text-align: left; }
.ticks span:last-child { transform: translateX(-100%); text-align: right; }
"""


@dataclass(frozen=True)
class Report:
    """What the page shows."""

    title: str
    metrics: dict[str, Any]  # the content of metrics.json
    pictures: dict[str, dict[str, str]] = field(default_factory=dict)  # photo -> title -> data URI
    facts: dict[str, str] = field(default_factory=dict)  # about the object and the run, by heading
    commands: Sequence[str] = ()  # that make these numbers again
    files: dict[str, Path] = field(default_factory=dict)  # of the run as a whole, by what they are
    photo_files: dict[str, dict[str, Path]] = field(default_factory=dict)  # photo -> the same


def write_report(path: Path, report: Report) -> None:
    """Write the page at `path`, atomically; it links to those of the report's files that exist."""
    write_bytes(path, report_page(report, path.parent).encode())


def report_page(report: Report, folder: Path) -> str:
    """Return the page as HTML with links relative to `folder`."""
    metrics = report.metrics
    body = [
        f"<h1>{html.escape(report.title)}</h1>",
        _facts(report, folder),
        _commands(report.commands),
        "<h2>Light from a single photo, by method</h2>",
        "<p>The light is predicted from each test photo, the object re-rendered with it and compared with the photo. "
        f"Means over {len(metrics['photos'])} test photos, ± the half width of their 95 % interval, for "
        "which photos under one light count once. Pictures and the "
        f"last table belong to <b>{html.escape(metrics['default_method'])}</b>.</p>",
        "<p>↑ more is better, ↓ less is better; the best value of a column is bold.</p>",
        _by_method(metrics, IMAGES),
        *_light_tables(metrics),
    ]
    if any(name in metrics["mean"] for name in OBJECT):
        body += ["<h2>The object against ground truth</h2>", score_list(metrics["mean"], OBJECT)]
    body.append("<h2>Test photos</h2>")
    shown = {title for pictures in report.pictures.values() for title in pictures}
    if shown:
        notes = ((title, note) for title, note in PICTURE_NOTES.items() if title in shown)
        body.append(folded("What the pictures show", notes))
    body += [_photo(report, name, folder) for name in report.pictures]
    body += ["<h2>Every photo</h2>", table("photo", metrics["photos"], IMAGES | LIGHTS | MAPS)]
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f"<title>{html.escape(report.title)}</title><style>{_STYLE}</style>"
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n' + "\n".join(body) + "\n</body></html>\n"


def evenly_spaced(names: Sequence[str], limit: int = MAX_ROWS) -> list[str]:
    """Return at most `limit` of `names`, evenly spread."""
    if len(names) <= limit:
        return list(names)
    return [names[i * len(names) // limit] for i in range(limit)]


def _facts(report: Report, folder: Path) -> str:
    facts = [f"{html.escape(heading)} {html.escape(fact)}" for heading, fact in report.facts.items()]
    return f'<p class="run">{" · ".join([*facts, *_links(report.files, folder)])}</p>'


def _commands(commands: Sequence[str]) -> str:
    if not commands:
        return ""
    lines = html.escape("\n".join(commands))
    return f"<details><summary>Commands that make these numbers again</summary><code>{lines}</code></details>"


def _links(files: dict[str, Path], folder: Path) -> list[str]:
    found = {name: os.path.relpath(path, folder) for name, path in files.items() if path.is_file()}
    return [f'<a href="{quote(Path(path).as_posix())}">{html.escape(name)}</a>' for name, path in found.items()]


def _by_method(metrics: dict[str, Any], headings: dict[str, Heading]) -> str:
    """Return a table of the methods' means.

    A slow method may have seen only some of the photos; its mean is of other photos, so its row says how many they
    are, has no interval and is never the best one.
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
    """Return the scores of the lights and the error by confidence, or nothing where the true lights are unknown."""
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


def _photo(report: Report, name: str, folder: Path) -> str:
    scores, pictures = report.metrics["photos"][name], report.pictures[name]
    notes = f"{scores['psnr_masked']:.2f} dB on the object" if "psnr_masked" in scores else ""
    links = " · ".join(_links(report.photo_files.get(name, {}), folder))
    header = f"<header><b>{html.escape(name)}</b><span>{notes}</span><span>{links}</span></header>"
    maps = [title for title in pictures if _is_of_the_light(title)]
    others = [title for title in pictures if title not in maps]
    rows = (("row", others), ("row maps", maps))
    grids = [
        f'<div class="{kind}">{"".join(_figure(title, pictures[title]) for title in titles)}</div>'
        for kind, titles in rows
        if titles
    ]
    return f"<section>{header}{''.join(grids)}</section>"


def _figure(title: str, uri: str) -> str:
    below = _scale() if title == CONFIDENCE else ""
    hint = PICTURE_HINTS.get(title)
    caption = html.escape(title) + (f"<br><small>{html.escape(hint)}</small>" if hint else "")
    return f'<figure><img alt="{html.escape(title)}" src="{uri}">{below}<figcaption>{caption}</figcaption></figure>'


def _scale() -> str:
    """Return the bar of the confidence's colours, with the factor that each means."""
    marks = "".join(
        f'<span style="left: {100 * place:.1f}%">{number}<br>{factor}</span>' for place, number, factor in ticks()
    )
    return f'<div class="scale" style="background: {css_gradient()}"></div><div class="ticks">{marks}</div>'


def _is_of_the_light(title: str) -> bool:
    return re.search(r"\blight\b", title) is not None or title == CONFIDENCE

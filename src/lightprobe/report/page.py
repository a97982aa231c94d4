"""Web pages that need no other file: style and script stand in them, pictures are data URIs.

The style and the script are `assets/report`; a page without the script still shows everything.
"""

import html
import os
from functools import cache
from importlib import resources
from pathlib import Path
from urllib.parse import quote

from lightprobe.prediction.confidence import css_gradient, ticks
from lightprobe.report.pictures import CONFIDENCE, PICTURE_HINTS

Links = dict[str, Path]  # what a file is -> where it is


def web_page(title: str, body: list[str]) -> str:
    """Return a page as HTML; `title` is text, `body` is HTML."""
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f"<title>{html.escape(title)}</title><style>{_asset('page.css')}</style>"
    script = f"<script>{_asset('page.js')}</script>"
    content = "\n".join(part for part in body if part)
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n{content}\n{script}</body></html>\n'


@cache
def _asset(name: str) -> str:
    return (resources.files("lightprobe") / "assets" / "report" / name).read_text("utf-8")


def figure(title: str, uri: str, caption: str | None = None) -> str:
    """Return a picture with its caption, by default its title and the hint of its kind; the confidence with
    its scale.

    uri: a data URI that has no quotes in it.
    """
    below, hint = _scale() if title == CONFIDENCE else "", PICTURE_HINTS.get(title)
    words = html.escape(title if caption is None else caption)
    words += f"<br><small>{html.escape(hint)}</small>" if hint else ""
    kind = ' class="wide"' if title == CONFIDENCE else ""  # its scale needs room
    return f'<figure{kind}><img alt="{html.escape(title)}" src="{uri}">{below}<figcaption>{words}</figcaption></figure>'


def links(files: Links, folder: Path) -> list[str]:
    """Return a link to each of the files that exist, relative to `folder`."""
    found = {name: os.path.relpath(path, folder) for name, path in files.items() if path.is_file()}
    return [
        f'<a href="{quote(Path(path).as_posix())}">{html.escape(name)}</a>' for name, path in found.items()
    ]


def facts_line(facts: dict[str, str], more: list[str]) -> str:
    """Return facts, by heading, and further HTML in one paragraph."""
    words = [f"{html.escape(heading)} {html.escape(fact)}" for heading, fact in facts.items()]
    return f'<p class="run">{" · ".join([*words, *more])}</p>'


def key_figures(figures: dict[str, str]) -> str:
    """Return a line of large numbers, each above what it is; nothing for none."""
    items = (
        f"<li><b>{html.escape(v)}</b><span>{html.escape(name)}</span></li>" for name, v in figures.items()
    )
    return f'<ul class="figures">{"".join(items)}</ul>' if figures else ""


def _scale() -> str:
    """Return the bar of the confidence's colours, with the factor that each means."""
    marks = "".join(
        f'<span style="left: {100 * place:.1f}%">{number}<br>{factor}</span>'
        for place, number, factor in ticks()
    )
    return f'<div class="scale" style="background: {css_gradient()}"></div><div class="ticks">{marks}</div>'

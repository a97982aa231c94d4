"""The tables of the report as HTML: arrows to the better values, the best ones in bold, and what the columns
mean.
"""

import html
from collections.abc import Iterable, Mapping
from typing import Any

from lightprobe.report.headings import Heading, Headings

Rows = dict[str, dict[str, Any]]  # label -> score -> value


def table(
    corner: str,
    rows: Rows,
    headings: Headings,
    *,
    intervals: Rows | None = None,
    compared: Iterable[str] = (),
    legend: bool = True,
    anchors: Mapping[str, str] | None = None,
) -> str:
    """Return a table with the columns that any row has, and the list of their meanings, folded.

    A known interval stands behind its value. `compared` are the rows whose best values are bold. `anchors`
    leads from a row's label to an element of the page.
    """
    used = {
        key: heading for key, heading in headings.items() if any(key in scores for scores in rows.values())
    }
    head = "".join(f'<th title="{html.escape(h.note)}"{_first(h)}>{headline(h)}</th>' for h in used.values())
    best = best_cells({name: rows[name] for name in compared if name in rows}, used)
    known, places = intervals or {}, anchors or {}
    lines = [
        f"<tr><td>{label(name, places)}</td>{''.join(_cells(name, scores, known.get(name, {}), used, best))}</tr>"
        for name, scores in rows.items()
    ]
    body = f"<thead><tr><th>{html.escape(corner)}</th>{head}</tr></thead><tbody>{''.join(lines)}</tbody>"
    return f'<div class="scroll"><table>{body}</table></div>{_legend(used) if legend else ""}'


def score_list(scores: dict[str, Any], headings: Headings) -> str:
    """Return the scores that there are below each other, each with its meaning."""
    lines = [
        f"<tr><td>{headline(heading)}</td><td>{heading.text(scores[key])}</td>"
        f'<td class="note">{html.escape(heading.note)}</td></tr>'
        for key, heading in headings.items()
        if key in scores
    ]
    return f'<div class="scroll"><table><tbody>{"".join(lines)}</tbody></table></div>'


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


def folded(summary: str, meanings: Iterable[tuple[str, str]]) -> str:
    """Return a list of terms and meanings that unfolds under `summary`."""
    entries = "".join(
        f"<dt>{html.escape(term)}</dt><dd>{html.escape(meaning)}</dd>" for term, meaning in meanings
    )
    return f"<details><summary>{html.escape(summary)}</summary><dl>{entries}</dl></details>"


def _legend(headings: Headings) -> str:
    return folded(
        "What the columns mean", ((f"{h.name} {h.arrow}".strip(), h.note) for h in headings.values())
    )


def label(name: str, anchors: Mapping[str, str]) -> str:
    """Return a row's name, leading to its element of the page where `anchors` knows one."""
    text = html.escape(name)
    return f'<a href="#{anchors[name]}">{text}</a>' if name in anchors else text


def _first(heading: Heading) -> str:
    """Return the order that a table is sorted in at the first click on a heading: better values above."""
    return ' data-first="descending"' if heading.more_is_better else ""


def headline(heading: Heading) -> str:
    """Return a score's name with the arrow to its better values."""
    arrow = f' <span class="arrow">{heading.arrow}</span>' if heading.arrow else ""
    return html.escape(heading.name) + arrow


def _cells(
    name: str,
    scores: dict[str, Any],
    interval: dict[str, Any],
    headings: Headings,
    best: set[tuple[str, str]],
) -> Iterable[str]:
    for key, heading in headings.items():
        if key not in scores:
            yield "<td>–</td>"
            continue
        value = heading.text(scores[key])
        value = f"<b>{value}</b>" if (name, key) in best else value
        margin = f"<small> ± {heading.text(interval[key])}</small>" if key in interval else ""
        yield f'<td data-value="{scores[key]:.6g}">{value}{margin}</td>'

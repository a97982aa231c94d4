"""Tables in Markdown, and numbers as they stand in them."""

import math
from collections.abc import Iterable, Mapping, Sequence

from lightprobe.evaluation.metrics import interval

NONE = "–"  # no value
Columns = Mapping[str, tuple[str, int]]  # score -> heading and decimals

# columns that are set to the left
_TEXT = ("method", "lessons", "trained", "role", "what differs", "command", "ours", "what it shows", "commit")


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table; the first column and columns of text are set to the left."""
    marks = ["---" if i == 0 or name in _TEXT else "---:" for i, name in enumerate(head)]
    return [f"| {' | '.join(cells)} |" for cells in (head, marks, *rows)]


def number(value: float | None, decimals: int) -> str:
    """Return a value without a leading zero; a dash for none."""
    if value is None or not math.isfinite(value):
        return NONE
    text = f"{value:.{decimals}f}"
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text


def signed(value: float) -> str:
    """Return a difference with its sign; a dash for none."""
    return f"{value:+.2f}" if math.isfinite(value) else NONE


def heads(columns: Columns) -> list[str]:
    """Return the headings of columns."""
    return [heading for heading, _ in columns.values()]


def score_cells(scores: Mapping[str, float], margins: Mapping[str, float], columns: Columns) -> list[str]:
    """Return the scores of the columns, each with its interval where there is one."""
    cells = []
    for key, (_, decimals) in columns.items():
        margin = f" ± {number(margins[key], decimals)}" if key in margins else ""
        cells.append(number(scores.get(key), decimals) + margin)
    return cells


def mean_cell(values: Sequence[float], decimals: int, *, with_range: bool = False) -> str:
    """Return the mean of independent values with its interval, and with the least and the largest value."""
    if not values:
        return NONE
    margin, text = interval(values), number(mean(values), decimals)
    text += f" ± {number(margin, decimals)}" if math.isfinite(margin) else ""
    both = f" ({number(min(values), decimals)} to {number(max(values), decimals)})"
    return text + both if with_range and len(values) > 1 else text


def mean(values: Sequence[float]) -> float:
    """Return the mean of one value or more."""
    return sum(values) / len(values)

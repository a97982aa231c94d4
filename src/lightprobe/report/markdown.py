"""Tables in Markdown, and numbers as they stand in them."""

import math
from collections.abc import Iterable, Mapping, Sequence

from lightprobe.evaluation.metrics import interval

NONE = "–"  # no value
_TEXT = (
    "method",
    "lessons",
    "trained",
    "role",
    "what differs",
    "command",
    "ours",
    "what it shows",
    "commit",
)  # set to the left


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table; the first column and those of text are set to the left."""
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


def score_cells(
    scores: Mapping[str, float], interval: Mapping[str, float], columns: Mapping[str, int]
) -> list[str]:
    """Return the scores in `columns` (score -> decimals), each with its interval where there is one."""
    cells = []
    for key, decimals in columns.items():
        margin = f" ± {number(interval[key], decimals)}" if key in interval else ""
        cells.append(number(scores.get(key), decimals) + margin)
    return cells


def mean_cell(values: Sequence[float], decimals: int, *, with_range: bool = False) -> str:
    """Return the mean of values that are independent of each other with its interval, and the range of the
    values.
    """
    if not values:
        return NONE
    margin = interval(values)
    text = number(mean(values), decimals) + (
        f" ± {number(margin, decimals)}" if math.isfinite(margin) else ""
    )
    both = f" ({number(min(values), decimals)} to {number(max(values), decimals)})"
    return text + both if with_range and len(values) > 1 else text


def mean(values: Sequence[float]) -> float:
    """Return the mean of one value or more."""
    return sum(values) / len(values)

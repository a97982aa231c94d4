"""Tables of how a cost grows with a size."""

from collections.abc import Mapping, Sequence

import numpy as np

Cases = dict[float, dict[str, float]]  # size -> what -> seconds, or bytes


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Return the power of the size with which the cost grows, fitted to logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def growth_rows(name: str, cases: Mapping[float, Mapping[str, float]], scale: float = 1000.0) -> list[str]:
    """Return the table of one kind of growth: costs times `scale` by size, and the exponent."""
    sizes = list(cases)
    rows = [f"| {name} | {' | '.join(f'{size:,.0f}' for size in sizes)} | exponent |"]
    rows.append("| --- |" + " ---: |" * (len(sizes) + 1))
    for what in cases[sizes[0]]:
        costs = [cases[size][what] for size in sizes]
        cells = " | ".join(f"{scale * value:.1f}" for value in costs)
        rows.append(f"| {what} | {cells} | {exponent(sizes, costs):.2f} |")
    return rows

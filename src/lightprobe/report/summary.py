"""An evaluation in a few tables and lines of text, as a console shows it."""

from dataclasses import dataclass
from typing import Any

from lightprobe.evaluation import Evaluation
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT

# title -> the scores that fit side by side in 80 columns
_TABLES = {
    "The photos, re-rendered under the predicted light": tuple(IMAGES),
    "Objects under predicted and under true light (of the balls: errors)": (
        "relit_psnr",
        "relit_psnr_scaled",
        "diffuse_si_rmse",
        "matte_si_rmse",
        "mirror_si_rmse",
    ),
    "Predicted against true light: the maps": (
        "light_log_rmse",
        "light_log_rmse_scaled",
        "light_log_rmse_channels",
    ),
}


@dataclass(frozen=True)
class SummaryTable:
    """The means of every method."""

    title: str
    columns: list[str]
    rows: dict[str, list[str]]  # method -> a cell for each column


def summary_tables(metrics: dict[str, Any]) -> list[SummaryTable]:
    """Return the tables of the means in `Evaluation.to_json`; no column or table in which nothing would
    stand.
    """
    rows, known, tables = metrics["methods"], IMAGES | LIGHTS | MAPS, []
    for title, names in _TABLES.items():
        columns = {name: known[name] for name in names if any(name in row for row in rows.values())}
        cells = {
            method: [h.text(row[name]) if name in row else "-" for name, h in columns.items()]
            for method, row in rows.items()
        }
        if columns:
            tables.append(SummaryTable(title, [heading.name for heading in columns.values()], cells))
    return tables


def summary_lines(evaluation: Evaluation) -> list[str]:
    """Return the scores of the asset, the count of doubtful photos and the check of the confidence."""
    metrics = evaluation.to_json()
    found = {heading: metrics["mean"][name] for name, heading in OBJECT.items() if name in metrics["mean"]}
    lines = ["The object against ground truth; relighting is under known novel lights:"] if found else []
    lines += [f"  {heading.name}: {heading.text(value)}" for heading, value in found.items()]
    lines.append(
        f"Photos whose verdict is doubtful: {metrics['verdicts']['doubtful']} of {len(metrics['photos'])}"
    )
    for method, checked in metrics["confidence"].items():
        errors = " ".join(f"{part['log_rmse_scaled']:.2f}" for part in checked["bins"])
        trend = "falls" if checked["falls"] else "does not fall throughout"
        lines.append(f"log-RMSE by confidence, {method}: {errors} ({trend})")
    return lines

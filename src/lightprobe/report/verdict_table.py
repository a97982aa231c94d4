"""What training said of its objects from their photos alone, beside what truth says of them: the table of
verdicts.
"""

from collections.abc import Sequence

from lightprobe.evaluation.three_spheres import SPHERES
from lightprobe.report.bench_results import BenchResults, default_scores, rows_table
from lightprobe.report.markdown import mean, number
from lightprobe.report.records import Kind, Record

_FOUND = "relight_psnr_scaled"  # what the verdict's decibels are of
_FEWEST = 4  # objects that an order can be told of


def verdict_table(results: BenchResults) -> list[str]:
    """Return a row for every run and seed that has a verdict from held-out photos and known truth.

    Below stands how well both agree.
    """
    told = [
        record
        for record in results.records
        if record.kind in (Kind.RUN, Kind.SEED)
        and record.object_verdict
        and _FOUND in record.metrics["mean"]
        and record.object_verdict.get("held_out", True)  # from photos it was fitted to a verdict says less
    ]
    rows: list[tuple[list[str], Record | None]] = []
    for record in told:
        verdict, truth, true = record.object_verdict, record.metrics["mean"], results.oracle.get(record.scene)
        cells = [
            record.scene,
            str(record.seed),
            verdict["trust"],
            number(100 * verdict["disagreement"], 1),
            number(verdict["surprise"], 1),
            number(verdict["expected_psnr"], 1),
            number(truth[_FOUND], 1),
            number(None if true is None else true.metrics["mean"].get(_FOUND), 1),
            number(truth.get("base_color_ratio"), 2),
            number(_spheres_expected(record), 3),
            number(_spheres(record), 3),
            number(None if true is None else _spheres(true), 3),
        ]
        rows.append((cells, record))
    head = ["scene", "seed", "verdict", "disagreement, %", "surprise", "relighting expected, dB", "found, dB"]
    head += [
        "true object's, dB",
        "base colour over truth",
        "spheres expected",
        "found",
        "true object's spheres",
    ]
    return [*rows_table(results, head, rows), *_agreement(told)]


def _agreement(told: Sequence[Record]) -> list[str]:
    """Return how well the verdict's order is that of the truth, and how far its decibels are off."""
    if len(told) < _FEWEST:
        return []
    expected = [record.object_verdict["expected_psnr"] for record in told]
    found = [record.metrics["mean"][_FOUND] for record in told]
    misses = [abs(a - b) for a, b in zip(expected, found, strict=True)]
    sentence = (
        f"Rank correlation (Spearman) of expected and found relighting over {len(told)} objects: "
        f"{number(_rank_correlation(expected, found), 2)}; mean miss {number(mean(misses), 1)} dB, worst "
        f"{number(max(misses), 1)} dB."
    )
    pairs = [(_spheres_expected(record), _spheres(record)) for record in told]
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    if len(known) >= _FEWEST:
        misses = [abs(a - b) for a, b in known]
        correlation = _rank_correlation(*zip(*known, strict=True))
        sentence += (
            f" Of the spheres' mean error over {len(known)}: {number(correlation, 2)}; "
            f"mean miss {number(mean(misses), 3)}, worst {number(max(misses), 3)}."
        )
    return ["", sentence]


def _rank_correlation(first: Sequence[float], second: Sequence[float]) -> float:
    import scipy.stats  # half a second

    return float(scipy.stats.spearmanr(first, second).statistic)


def _spheres_expected(record: Record) -> float | None:
    """Return the mean of the three si-RMSE on simulated photos; None where training measured none."""
    found = record.light_accuracy.get("spheres")
    return None if found is None else mean(found)


def _spheres(record: Record) -> float | None:
    """Return the mean of the default method's three si-RMSE, None where no true light is known."""
    scores = default_scores(record.metrics)
    found = [scores[f"{sphere}_si_rmse"] for sphere in SPHERES if f"{sphere}_si_rmse" in scores]
    return mean(found) if len(found) == len(SPHERES) else None

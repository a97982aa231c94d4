"""What training said of its objects from their photos alone, beside what truth says of them: the table of verdicts."""

from collections.abc import Sequence

from lightprobe.evaluation.three_spheres import SPHERES
from lightprobe.report.bench_results import BenchResults, default_scores
from lightprobe.report.markdown import NONE, markdown_table, mean, number
from lightprobe.report.records import Kind, Record

_FEWEST = 4  # objects that an order can be told of


def verdict_table(results: BenchResults) -> list[str]:
    """Return a row for every run and seed whose object has a verdict and known truth, and below how well both agree."""
    told = [
        r for r in results.records if r.kind in (Kind.RUN, Kind.SEED) and r.object_verdict and _relit(r) is not None
    ]
    rows = []
    for record in told:
        verdict, spheres = record.object_verdict, _spheres(record)
        rows.append([
            record.scene, str(record.seed), verdict["trust"], number(100 * verdict["disagreement"], 1),
            number(verdict["surprise"], 1), number(verdict["expected_psnr"], 1), number(_relit(record), 1),
            number(record.metrics["mean"].get("base_color_ratio"), 2), NONE if spheres is None else number(spheres, 3),
            *((record.commit,) if results.mixed else ()),
        ])  # fmt: skip
    head = ["scene", "seed", "verdict", "disagreement, %", "surprise", "relighting expected, dB", "found, dB"]
    head += ["base colour over truth", "spheres, mean", *(["commit"] if results.mixed else [])]
    return [*markdown_table(head, rows), *_agreement(told)] if rows else []


def _agreement(told: Sequence[Record]) -> list[str]:
    """Return how well the verdict's order is that of the truth, and how far its decibels are off."""
    if len(told) < _FEWEST:
        return []
    expected, found = ([r.object_verdict["expected_psnr"] for r in told], [_relit(r) or 0.0 for r in told])
    misses = [abs(a - b) for a, b in zip(expected, found, strict=True)]
    sentence = (
        f"Rank correlation (Spearman) of expected and found relighting over {len(told)} objects: "
        f"{number(_rank_correlation(expected, found), 2)}; mean miss {number(mean(misses), 1)} dB, worst "
        f"{number(max(misses), 1)} dB."
    )
    known = [(r.object_verdict["disagreement"], s) for r in told if (s := _spheres(r)) is not None]
    if len(known) >= _FEWEST:
        correlation = _rank_correlation(*zip(*known, strict=True))
        sentence += f" Of disagreement and the spheres' mean error: {number(correlation, 2)}."
    return ["", sentence]


def _rank_correlation(first: Sequence[float], second: Sequence[float]) -> float:
    import scipy.stats  # half a second

    return float(scipy.stats.spearmanr(first, second).statistic)


def _relit(record: Record) -> float | None:
    return record.metrics["mean"].get("relight_psnr_scaled")


def _spheres(record: Record) -> float | None:
    """Return the mean of the default method's three si-RMSE, None where no true light is known."""
    scores = default_scores(record.metrics)
    found = [scores[f"{sphere}_si_rmse"] for sphere in SPHERES if f"{sphere}_si_rmse" in scores]
    return mean(found) if len(found) == len(SPHERES) else None

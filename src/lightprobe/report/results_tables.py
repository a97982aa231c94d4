"""The tables of the results' page: each takes all records of a benchmark and returns lines of Markdown, or
none.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

from lightprobe.evaluation.three_spheres import SPHERES
from lightprobe.report.bench_results import (
    PAPER_LESSONS,
    PAPER_METHOD,
    BenchResults,
    default_scores,
    method_name,
    partial_photos,
    rows_table,
    whole,
)
from lightprobe.report.bench_scenes import BENCH_SCENES, ordered, role
from lightprobe.report.markdown import NONE, markdown_table, mean, mean_cell, number, score_cells, signed
from lightprobe.report.published import PUBLISHED_LIGHTS, paper_scores
from lightprobe.report.records import Record

_RMSE = {f"{sphere}_si_rmse": 3 for sphere in SPHERES}
_ANGLES = {f"{sphere}_angular": 1 for sphere in SPHERES}
_BRIGHT = {"light_log_rmse_bright": 2, "light_log_rmse_bright_scaled": 2}
_AS_TRAINED = "as trained"


def scene_table(results: BenchResults) -> list[str]:
    """Return every scene of the program's own list and of the records: what it was used for, photos and
    lights.
    """
    rows: list[tuple[list[str], Record | None]] = []
    for name in ordered([*BENCH_SCENES, *results.runs]):
        record = results.runs.get(name)
        if record is None:
            rows.append(([name, role(name).value, "**not yet scored**", NONE], None))
            continue
        photos = record.metrics["photos"].values()
        lights = {photo["light"] for photo in photos if "light" in photo}
        rows.append(
            ([name, role(name).value, str(len(photos)), str(len(lights)) if lights else "not named"], record)
        )
    return rows_table(results, ["scene", "role", "test photos", "lights"], rows)


def image_table(results: BenchResults) -> list[str]:
    """Return PSNR and SSIM under protocols A and B, method by scene."""
    columns = {"psnr": 2, "ssim": 3, "psnr_masked": 2, "ssim_masked": 3, "psnr_unseen": 2}
    heads = ["PSNR", "SSIM", "PSNR object", "SSIM object", "PSNR unseen"]
    return _method_table(results, heads, columns, [results.runs, results.paper], results.runs)


def light_table(results: BenchResults) -> list[str]:
    """Return the errors of the lights, method by scene, with the rows of the true object below."""
    columns = {
        "relit_psnr": 2,
        "relit_psnr_scaled": 2,
        **_RMSE,
        **_ANGLES,
        "light_log_rmse": 2,
        "light_log_rmse_scaled": 2,
        "light_log_rmse_channels": 2,
        **_BRIGHT,
    }
    heads = [
        "relit, raw",
        "scaled",
        *SPHERES,
        *(f"{s} °" for s in SPHERES),
        "log-RMSE, raw",
        "scaled",
        "per channel",
    ]
    heads += ["brightest, raw", "scaled"]
    known = [
        name for name, record in results.runs.items() if "light_log_rmse" in default_scores(record.metrics)
    ]
    return _method_table(results, heads, columns, [results.runs, results.paper, results.oracle], known)


def published_images_table(results: BenchResults) -> list[str]:
    """Return what the paper publishes for scenes that were scored, beside ours on them."""
    rows: list[tuple[list[str], Record | None]] = []
    for name, record in results.runs.items():
        published = paper_scores(name)
        if published is None:
            continue
        rows.append(([name, "the paper, as published", *published], None))
        ours = [(record, record.metrics["default_method"]), (record, PAPER_METHOD)]
        ours += [(results.paper[name], PAPER_METHOD)] if name in results.paper else []
        for source, method in ours:
            if method in source.metrics["methods"]:
                cells = score_cells(source.metrics["methods"][method], {}, {"psnr": 2, "ssim": 3})
                rows.append(([name, f"ours, {method_name(method, source)}", *cells], source))
    return rows_table(results, ["scene", "method", "PSNR", "SSIM"], rows)


def published_lights_table(results: BenchResults) -> list[str]:
    """Return the three spheres in the mean of all scenes with true lights beside published ones, and what
    differs.
    """
    runs = [r for r in results.runs.values() if f"{SPHERES[0]}_si_rmse" in default_scores(r.metrics)]
    true = [results.oracle[r.scene] for r in runs if r.scene in results.oracle]
    lines: list[tuple[str, list[Record], str | None]] = [
        ("ours, default", runs, None),
        ("ours, default, true object", true, None),
        *((f"ours, {method_name(PAPER_METHOD, r)}", runs, PAPER_METHOD) for r in runs[:1]),
        *((f"ours, {method_name(PAPER_METHOD, r)}", [r], PAPER_METHOD) for r in results.paper.values()),
        ("ours, constant map", runs, "constant"),
    ]
    rows = []
    for label, records, method in lines:
        scores = {
            r.scene: r.metrics["methods"].get(method or r.metrics["default_method"], {}) for r in records
        }
        scores = {scene: each for scene, each in scores.items() if f"{SPHERES[0]}_si_rmse" in each}
        if scores:
            means = {
                key: mean([s[key] for s in scores.values()])
                for key in (*_RMSE, *_ANGLES)
                if _in_all(key, scores)
            }
            cells = score_cells(means, {}, _RMSE | _ANGLES)
            rows.append([label, *cells, f"mean of {', '.join(scores)}; from one photo of a known object"])
    if not rows:
        return []
    rows += [[p.name, *score_cells(p.scores, {}, _RMSE | _ANGLES), p.difference] for p in PUBLISHED_LIGHTS]
    return markdown_table(["light", *SPHERES, *(f"{s} °" for s in SPHERES), "what differs"], rows)


def seed_table(results: BenchResults) -> list[str]:
    """Return the default method over training seeds: means, intervals over seeds, and the least and the
    largest.
    """
    columns = {
        "psnr": 2,
        "psnr_masked": 2,
        "psnr_unseen": 2,
        "relit_psnr": 2,
        "relit_psnr_scaled": 2,
        **_RMSE,
        "light_log_rmse": 2,
        "light_log_rmse_scaled": 2,
    }
    rows = []
    for name, records in results.seeds.items():
        means = [default_scores(record.metrics) for record in records]
        cells = [
            mean_cell([m[key] for m in means if key in m], d, with_range=True) for key, d in columns.items()
        ]
        rows.append([name, ", ".join(str(record.seed) for record in records), *cells])
    head = ["scene", "seeds", "PSNR", "PSNR object", "PSNR unseen", "relit, raw", "scaled", *SPHERES]
    return markdown_table([*head, "log-RMSE, raw", "scaled"], rows) if rows else []


def comparison_table(results: BenchResults) -> list[str]:
    """Return what the default gains over `probe-mlp`, by how that was trained, and the means over scenes."""
    rows: list[tuple[list[str], Record | None]] = []
    others = ((_AS_TRAINED, results.runs), (PAPER_LESSONS, results.lessons.get(PAPER_LESSONS, {})))
    for lessons, records in others:
        preset = next((record.preset for record in records.values()), "")
        rows += _gains(results, records, f"{preset}, {lessons}" if preset else lessons)
    for name, record in results.paper.items():
        rows += _gains(results, {name: record}, f"paper's settings, {record.iterations} iterations")
    head = ["relit, raw, dB", "scaled, dB", "object, dB", "unseen, dB", *(f"{s}, ratio" for s in SPHERES)]
    return rows_table(results, ["scene", "trained", *head, "log-RMSE, raw", "scaled"], rows)


def _gains(
    results: BenchResults, others: Mapping[str, Record], trained: str
) -> list[tuple[list[str], Record | None]]:
    """Return the rows of one way to train the paper's method; below more than one scene stands their mean.

    Only scenes with known lights.
    """
    found: dict[str, list[float]] = {}
    for name, record in results.runs.items():
        other = others[name].metrics["methods"].get(PAPER_METHOD, {}) if name in others else {}
        default = default_scores(record.metrics)
        if not other or "relit_psnr_scaled" not in default:
            continue
        keys = ("relit_psnr", "relit_psnr_scaled", "psnr_masked", "psnr_unseen")
        logs = ("light_log_rmse", "light_log_rmse_scaled")
        differences = {
            k: default[k] - other[k] if k in other and k in default else math.nan for k in (*keys, *logs)
        }
        ratios = [default[key] / other[key] for key in _RMSE]
        found[name] = [*(differences[k] for k in keys), *ratios, *(differences[k] for k in logs)]
    if len(found) > 1:
        found["**mean**"] = [mean(values) for values in zip(*found.values(), strict=True)]
    return [
        (
            [name, trained, *map(signed, v[:4]), *(f"{ratio:.2f}" for ratio in v[4:7]), *map(signed, v[7:])],
            others.get(name),
        )
        for name, v in found.items()
    ]


def lessons_table(results: BenchResults) -> list[str]:
    """Return the learned methods after each kind of lessons, on every scene that has more than one."""
    columns = {
        "psnr_masked": 2,
        "psnr_unseen": 2,
        "relit_psnr": 2,
        "relit_psnr_scaled": 2,
        **_RMSE,
        "light_log_rmse": 2,
        "light_log_rmse_scaled": 2,
    }
    every = {_AS_TRAINED: results.runs, **results.lessons}
    rows = []
    for name in results.runs:
        found = {kind: records[name] for kind, records in every.items() if name in records}
        if len(found) < 2:
            continue
        for method in list(found.values())[-1].metrics["methods"]:
            for kind, record in found.items():
                scores = record.metrics["methods"].get(method, {})
                cells = score_cells(scores, record.metrics["interval"].get(method, {}), columns)
                rows.append(([name, method_name(method, record), kind, *cells], record))
    head = ["scene", "method", "lessons", "PSNR object", "PSNR unseen", "relit, raw", "scaled", *SPHERES]
    return rows_table(results, [*head, "log-RMSE, raw", "scaled"], rows)


def slow_table(results: BenchResults) -> list[str]:
    """Return the default method beside every method that was scored on a part of the photos, on that part."""
    columns = {
        "psnr_masked": 2,
        "psnr_unseen": 2,
        "relit_psnr": 2,
        "relit_psnr_scaled": 2,
        **_RMSE,
        "light_log_rmse": 2,
        "light_log_rmse_scaled": 2,
        "seconds": 2,
    }
    rows = []
    for name, record in results.runs.items():
        for method in record.metrics["methods"]:
            shared = partial_photos(record.metrics, method)
            for which in (record.metrics["default_method"], method) if shared else ():
                values = {key: [each[which][key] for each in shared if key in each[which]] for key in columns}
                cells = score_cells({key: mean(found) for key, found in values.items() if found}, {}, columns)
                photos = f"{len(shared)} photo{'' if len(shared) == 1 else 's'}"
                rows.append(([name, f"{method_name(which, record)} ({photos})", *cells], record))
    head = ["scene", "method", "PSNR object", "PSNR unseen", "relit, raw", "scaled", *SPHERES]
    return rows_table(results, [*head, "log-RMSE, raw", "scaled", "seconds"], rows)


def object_table(results: BenchResults) -> list[str]:
    """Return the reconstructed objects against the truth, and how the true ones fare in our renderer."""
    columns = {
        "base_color_ratio": 2,
        "base_color_ratio_worst": 2,
        "base_color_psnr": 1,
        "base_color_psnr_scaled": 1,
        "roughness_mae": 3,
        "metallic_mae": 3,
        "normal_degrees": 1,
        "chamfer": 4,
        "relight_psnr": 1,
        "relight_psnr_scaled": 1,
        "relight_ssim": 3,
        "relight_ssim_scaled": 3,
    }
    rows = []
    for source, mark in (
        (results.runs, ""),
        (results.paper, ", paper's settings"),
        (results.oracle, ", true object"),
    ):
        for name, record in source.items():
            if "relight_psnr" in record.metrics["mean"] or "chamfer" in record.metrics["mean"]:
                rows.append(([name + mark, *score_cells(record.metrics["mean"], {}, columns)], record))
    head = [
        "scene",
        "base colour over truth",
        "worst channel",
        "base colour, raw",
        "scaled",
        "roughness",
        "metallic",
    ]
    head += ["normals °", "Chamfer", "relighting, raw", "scaled", "SSIM, raw", "scaled"]
    return rows_table(results, head, rows)


def confidence_table(results: BenchResults) -> list[str]:
    """Return the log-RMSE in the five bins of confidence, and whether it falls."""
    rows = []
    for source, mark in ((results.runs, ""), (results.paper, ""), (results.oracle, ", true object")):
        for name, record in source.items():
            for method, checked in record.metrics["confidence"].items():
                if partial_photos(record.metrics, method):
                    continue
                bins = checked["bins"]
                errors = [f"{part['log_rmse_scaled']:.2f} ({part['log_rmse']:.2f})" for part in bins]
                trust = f"{bins[0]['confidence']:.2f} to {bins[-1]['confidence']:.2f}"
                verdict = "yes" if checked["falls"] else "**no**"
                rows.append(([name + mark, method_name(method, record), *errors, trust, verdict], record))
    return rows_table(
        results, ["scene", "method", "least", "2", "3", "4", "most", "confidence", "falls"], rows
    )


def time_table(results: BenchResults) -> list[str]:
    """Return the seconds per photo of each method, and the seconds of both phases of training."""
    found = [(method, record) for record in results.runs.values() for method in record.metrics["methods"]]
    methods = {method: method_name(method, record) for method, record in found}
    rows = []
    for source, mark in ((results.runs, ""), (results.paper, ", paper's settings")):
        for name, record in source.items():
            each = record.metrics["methods"]
            seconds = [number(each.get(method, {}).get("seconds"), 2) for method in methods]
            phases = [number(record.training.get(phase), 0) for phase in ("decompose", "distill")]
            rows.append(([name + mark, *seconds, *phases, number(record.training.get("memory"), 2)], record))
    return rows_table(results, ["scene", *methods.values(), "Phase I, s", "Phase II, s", "GiB"], rows)


def loss_table(results: BenchResults) -> list[str]:
    """Return the variants of Phase II with means and 95 % intervals over seeds."""
    columns = {
        "psnr": 2,
        "ssim": 4,
        "psnr_masked": 2,
        "relit_psnr": 2,
        "relit_psnr_scaled": 2,
        **{f"{s}_si_rmse": 4 for s in SPHERES},
        "light_log_rmse": 3,
        "light_log_rmse_scaled": 3,
    }
    rows = []
    for variant, records in results.losses.items():
        means = [record.metrics["methods"][PAPER_METHOD] for record in records]
        cells = [
            mean_cell([m[key] for m in means if key in m], decimals) for key, decimals in columns.items()
        ]
        rows.append([variant, str(len(records)), *cells])
    head = [
        "loss",
        "seeds",
        "PSNR",
        "SSIM",
        "PSNR object",
        "relit, raw",
        "scaled",
        *SPHERES,
        "log-RMSE, raw",
        "scaled",
    ]
    return markdown_table(head, rows) if rows else []


def record_table(results: BenchResults) -> list[str]:
    """Return how each record was made."""
    rows = [
        [
            r.name,
            r.commit or NONE,
            r.trained or NONE,
            r.preset or NONE,
            str(r.seed),
            r.machine,
            r.threads,
            f"`{r.command}`",
        ]
        for r in results.records
    ]
    head = ["record", "commit", "trained at", "preset", "seed", "machine", "threads", "command"]
    return markdown_table(head, rows) if rows else []


def _method_table(
    results: BenchResults,
    heads: list[str],
    columns: dict[str, int],
    sources: Sequence[Mapping[str, Record]],
    scenes: Iterable[str],
) -> list[str]:
    rows = []
    for name in scenes:
        for source in sources:
            if name not in source:
                continue
            record = source[name]
            mark = ", true object" if source is results.oracle else ""
            for method, scores in whole(record.metrics).items():
                cells = score_cells(scores, record.metrics["interval"].get(method, {}), columns)
                rows.append(([name + mark, method_name(method, record), *cells], record))
    return rows_table(results, ["scene", "method", *heads], rows)


def _in_all(key: str, scores: Mapping[str, Mapping[str, float]]) -> bool:
    return all(key in each for each in scores.values())

"""RESULTS.md from the records of a benchmark: its tables and what is said about them.

    python -m benchmarks tables [--records DIR] [--results RESULTS.md] [--paper paper-tables.md]

Each table takes all records and returns lines of Markdown, [] where there is nothing to show.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from benchmarks.markdown import (
    NONE,
    Columns,
    heads,
    markdown_table,
    mean,
    mean_cell,
    number,
    score_cells,
    signed,
)
from benchmarks.paper_tables import paper_page
from benchmarks.published import PUBLISHED_LIGHTS, paper_scores
from benchmarks.record import Kind, Record, read_records
from benchmarks.results import (
    BENCH_SCENES,
    PAPER_LESSONS,
    PAPER_METHOD,
    BenchResults,
    Rows,
    default_scores,
    method_name,
    ordered,
    partial_photos,
    role,
    rows_table,
)
from lightprobe.core.errors import ConfigError
from lightprobe.core.files import write_bytes
from lightprobe.evaluation.three_spheres import SPHERES

RECORDS, RESULTS = Path("benchmarks/records"), Path("benchmarks/RESULTS.md")
TRUE_OBJECT, PAPER_SETTINGS, AS_TRAINED = ", true object", ", paper's settings", "as trained"

_RELIT: Columns = {"relit_psnr": ("relit, raw", 2), "relit_psnr_scaled": ("scaled", 2)}
_RMSE: Columns = {f"{sphere}_si_rmse": (sphere, 3) for sphere in SPHERES}
_ANGLES: Columns = {f"{sphere}_angular": (f"{sphere} °", 1) for sphere in SPHERES}
_LOGS: Columns = {"light_log_rmse": ("log-RMSE, raw", 2), "light_log_rmse_scaled": ("scaled", 2)}
_IMAGES: Columns = {
    "psnr": ("PSNR", 2),
    "ssim": ("SSIM", 3),
    "psnr_masked": ("PSNR object", 2),
    "ssim_masked": ("SSIM object", 3),
    "psnr_unseen": ("PSNR unseen", 2),
}
_FRAME: Columns = {key: _IMAGES[key] for key in ("psnr", "ssim")}
_OF_OBJECT: Columns = {key: _IMAGES[key] for key in ("psnr_masked", "psnr_unseen")}
_LIGHTS: Columns = {
    **(_RELIT | _RMSE | _ANGLES | _LOGS),
    "light_log_rmse_channels": ("per channel", 2),
    "light_log_rmse_bright": ("brightest, raw", 2),
    "light_log_rmse_bright_scaled": ("scaled", 2),
}
_MAIN: Columns = _OF_OBJECT | _RELIT | _RMSE | _LOGS
_OBJECT: Columns = {
    "base_color_ratio": ("base colour over truth", 2),
    "base_color_ratio_worst": ("worst channel", 2),
    "base_color_psnr": ("base colour, raw", 1),
    "base_color_psnr_scaled": ("scaled", 1),
    "roughness_mae": ("roughness", 3),
    "metallic_mae": ("metallic", 3),
    "normal_degrees": ("normals °", 1),
    "chamfer": ("Chamfer", 4),
    "relight_psnr": ("relighting, raw", 1),
    "relight_psnr_scaled": ("scaled", 1),
    "relight_ssim": ("SSIM, raw", 3),
    "relight_ssim_scaled": ("scaled", 3),
}


def scene_table(results: BenchResults) -> list[str]:
    """Return every scene of the program's own list and of the records: what it was used for, photos and lights."""
    rows: Rows = []
    for name in ordered([*BENCH_SCENES, *results.runs]):
        record, cells = results.runs.get(name), ["**not yet scored**", NONE]
        if record is not None:
            photos = record.metrics["photos"].values()
            lights = {photo["light"] for photo in photos if "light" in photo}
            cells = [str(len(photos)), str(len(lights)) if lights else "not named"]
        rows.append(([name, role(name).value, *cells], record))
    return rows_table(results, ["scene", "role", "test photos", "lights"], rows)


def image_table(results: BenchResults) -> list[str]:
    """Return PSNR and SSIM under protocols A and B, method by scene."""
    return _method_table(results, _IMAGES, [results.runs, results.paper], results.runs)


def light_table(results: BenchResults) -> list[str]:
    """Return the errors of the lights, method by scene, with the rows of the true object below."""
    known = [name for name, r in results.runs.items() if "light_log_rmse" in default_scores(r.metrics)]
    return _method_table(results, _LIGHTS, [results.runs, results.paper, results.oracle], known)


def _method_table(
    results: BenchResults,
    columns: Columns,
    sources: Sequence[Mapping[str, Record]],
    scenes: Iterable[str],
) -> list[str]:
    rows: Rows = []
    for record in (source[name] for name in scenes for source in sources if name in source):
        name = record.scene + (TRUE_OBJECT if record.kind is Kind.ORACLE else "")
        for method, scores in record.metrics["methods"].items():
            if not partial_photos(record.metrics, method):
                cells = score_cells(scores, record.metrics["interval"].get(method, {}), columns)
                rows.append(([name, method_name(method, record), *cells], record))
    return rows_table(results, ["scene", "method", *heads(columns)], rows)


def published_images_table(results: BenchResults) -> list[str]:
    """Return what the paper publishes for scenes that were scored, beside ours on them."""
    rows: Rows = []
    for name, record in results.runs.items():
        published = paper_scores(name)
        if published is None:
            continue
        rows.append(([name, "the paper, as published", *published], None))
        ours = [(record, record.metrics["default_method"]), (record, PAPER_METHOD)]
        ours += [(results.paper[name], PAPER_METHOD)] if name in results.paper else []
        for source, method in ours:
            if method in source.metrics["methods"]:
                cells = score_cells(source.metrics["methods"][method], {}, _FRAME)
                rows.append(([name, f"ours, {method_name(method, source)}", *cells], source))
    return rows_table(results, ["scene", "method", *heads(_FRAME)], rows)


def published_lights_table(results: BenchResults) -> list[str]:
    """Return the three spheres in the mean of all scenes with true lights beside published ones."""
    columns = _RMSE | _ANGLES
    runs = [r for r in results.runs.values() if f"{SPHERES[0]}_si_rmse" in default_scores(r.metrics)]
    lines: list[tuple[str, list[Record], str | None]] = [
        ("ours, default", runs, None),
        (
            "ours, default, true object",
            [results.oracle[r.scene] for r in runs if r.scene in results.oracle],
            None,
        ),
        *((f"ours, {method_name(PAPER_METHOD, r)}", runs, PAPER_METHOD) for r in runs[:1]),
        *((f"ours, {method_name(PAPER_METHOD, r)}", [r], PAPER_METHOD) for r in results.paper.values()),
        ("ours, constant map", runs, "constant"),
    ]
    rows = []
    for label, records, method in lines:
        every = {
            r.scene: r.metrics["methods"].get(method or r.metrics["default_method"], {}) for r in records
        }
        scores = {scene: each for scene, each in every.items() if f"{SPHERES[0]}_si_rmse" in each}
        if scores:
            shared = [key for key in columns if all(key in each for each in scores.values())]
            means = {key: mean([each[key] for each in scores.values()]) for key in shared}
            about = f"mean of {', '.join(scores)}; from one photo of a known object"
            rows.append([label, *score_cells(means, {}, columns), about])
    if not rows:
        return []
    rows += [[p.name, *score_cells(p.scores, {}, columns), p.difference] for p in PUBLISHED_LIGHTS]
    return markdown_table(["light", *heads(columns), "what differs"], rows)


def seed_table(results: BenchResults) -> list[str]:
    """Return the default method over training seeds: means, intervals over seeds, least and largest."""
    columns = {"psnr": _IMAGES["psnr"], **_MAIN}
    rows = []
    for name, records in results.seeds.items():
        means = [default_scores(record.metrics) for record in records]
        seeds = ", ".join(str(record.seed) for record in records)
        rows.append([name, seeds, *_mean_cells(means, columns, with_range=True)])
    return markdown_table(["scene", "seeds", *heads(columns)], rows) if rows else []


def _mean_cells(
    scores: Sequence[Mapping[str, float]], columns: Columns, *, with_range: bool = False
) -> list[str]:
    return [
        mean_cell([each[key] for each in scores if key in each], decimals, with_range=with_range)
        for key, (_, decimals) in columns.items()
    ]


def comparison_table(results: BenchResults) -> list[str]:
    """Return what the default gains over `probe-mlp`, by how that was trained, and the means over scenes."""
    rows: Rows = []
    others = ((AS_TRAINED, results.runs), (PAPER_LESSONS, results.lessons.get(PAPER_LESSONS, {})))
    for lessons, records in others:
        preset = next((record.preset for record in records.values()), "")
        rows += _gains(results, records, f"{preset}, {lessons}" if preset else lessons)
    for name, record in results.paper.items():
        rows += _gains(results, {name: record}, f"paper's settings, {record.iterations} iterations")
    head = ["relit, raw, dB", "scaled, dB", "object, dB", "unseen, dB", *(f"{s}, ratio" for s in SPHERES)]
    return rows_table(results, ["scene", "trained", *head, *heads(_LOGS)], rows)


def _gains(results: BenchResults, others: Mapping[str, Record], trained: str) -> Rows:
    """Return the rows of one way to train the paper's method, on scenes with known lights, and their mean."""
    found: dict[str, list[float]] = {}
    for name, record in results.runs.items():
        other = others[name].metrics["methods"].get(PAPER_METHOD, {}) if name in others else {}
        default = default_scores(record.metrics)
        if other and "relit_psnr_scaled" in default:
            differences = [
                default[key] - other[key] if key in other and key in default else math.nan
                for key in (*_RELIT, *_OF_OBJECT, *_LOGS)
            ]
            ratios = [default[key] / other[key] for key in _RMSE]
            found[name] = [*differences[:4], *ratios, *differences[4:]]
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
    """Return the learned methods after each kind of training examples, on every scene that has several."""
    rows: Rows = []
    for name in results.runs:
        every = {AS_TRAINED: results.runs, **results.lessons}
        found = {kind: records[name] for kind, records in every.items() if name in records}
        for method in list(found.values())[-1].metrics["methods"] if len(found) > 1 else ():
            for kind, record in found.items():
                scores, margins = record.metrics["methods"].get(method, {}), record.metrics["interval"]
                cells = score_cells(scores, margins.get(method, {}), _MAIN)
                rows.append(([name, method_name(method, record), kind, *cells], record))
    return rows_table(results, ["scene", "method", "lessons", *heads(_MAIN)], rows)


def slow_table(results: BenchResults) -> list[str]:
    """Return the default method beside every method that was scored on a part of the photos, on that part."""
    columns: Columns = {**_MAIN, "seconds": ("seconds", 2)}
    rows: Rows = []
    for name, record in results.runs.items():
        for method in record.metrics["methods"]:
            shared = partial_photos(record.metrics, method)
            for which in (record.metrics["default_method"], method) if shared else ():
                values = {key: [each[which][key] for each in shared if key in each[which]] for key in columns}
                cells = score_cells({key: mean(found) for key, found in values.items() if found}, {}, columns)
                photos = f"{len(shared)} photo{'' if len(shared) == 1 else 's'}"
                rows.append(([name, f"{method_name(which, record)} ({photos})", *cells], record))
    return rows_table(results, ["scene", "method", *heads(columns)], rows)


def object_table(results: BenchResults) -> list[str]:
    """Return the reconstructed objects against the truth, and how the true ones fare in our renderer."""
    sources = ((results.runs, ""), (results.paper, PAPER_SETTINGS), (results.oracle, TRUE_OBJECT))
    rows: Rows = [
        ([name + mark, *score_cells(record.metrics["mean"], {}, _OBJECT)], record)
        for source, mark in sources
        for name, record in source.items()
        if {"relight_psnr", "chamfer"} & record.metrics["mean"].keys()
    ]
    return rows_table(results, ["scene", *heads(_OBJECT)], rows)


def confidence_table(results: BenchResults) -> list[str]:
    """Return the log-RMSE in the five bins of confidence, and whether it falls."""
    rows: Rows = []
    for source, mark in ((results.runs, ""), (results.paper, ""), (results.oracle, TRUE_OBJECT)):
        for name, record in source.items():
            for method, checked in record.metrics["confidence"].items():
                if partial_photos(record.metrics, method):
                    continue
                bins = checked["bins"]
                errors = [f"{part['log_rmse_scaled']:.2f} ({part['log_rmse']:.2f})" for part in bins]
                trust = f"{bins[0]['confidence']:.2f} to {bins[-1]['confidence']:.2f}"
                falls = "yes" if checked["falls"] else "**no**"
                rows.append(([name + mark, method_name(method, record), *errors, trust, falls], record))
    head = ["scene", "method", "least", "2", "3", "4", "most", "confidence", "falls"]
    return rows_table(results, head, rows)


def time_table(results: BenchResults) -> list[str]:
    """Return the seconds per photo of each method, and the seconds of both phases of training."""
    methods = {
        m: method_name(m, record) for record in results.runs.values() for m in record.metrics["methods"]
    }
    rows: Rows = []
    for source, mark in ((results.runs, ""), (results.paper, PAPER_SETTINGS)):
        for name, record in source.items():
            each = record.metrics["methods"]
            seconds = [number(each.get(method, {}).get("seconds"), 2) for method in methods]
            phases = [number(record.training.get(phase), 0) for phase in ("decompose", "distill")]
            rows.append(([name + mark, *seconds, *phases, number(record.training.get("memory"), 2)], record))
    return rows_table(results, ["scene", *methods.values(), "Phase I, s", "Phase II, s", "GiB"], rows)


def loss_table(results: BenchResults) -> list[str]:
    """Return the variants of Phase II with means and 95 % intervals over seeds."""
    finer = {"ssim": 4, **dict.fromkeys(_RMSE, 4), **dict.fromkeys(_LOGS, 3)}
    columns = _FRAME | {"psnr_masked": _IMAGES["psnr_masked"]} | _RELIT | _RMSE | _LOGS
    columns = {key: (head, finer.get(key, decimals)) for key, (head, decimals) in columns.items()}
    rows = []
    for variant, records in results.losses.items():
        means = [record.metrics["methods"][PAPER_METHOD] for record in records]
        rows.append([variant, str(len(records)), *_mean_cells(means, columns)])
    return markdown_table(["loss", "seeds", *heads(columns)], rows) if rows else []


def verdict_table(results: BenchResults) -> list[str]:
    """Return the verdict of every run and seed from held-out photos beside the known truth, and how well they agree."""
    told = [
        record
        for record in results.records
        if record.kind in (Kind.RUN, Kind.SEED)
        and record.object_verdict
        and "relight_psnr_scaled" in record.metrics["mean"]
        and record.object_verdict.get("held_out", True)  # from photos it was fitted to a verdict says less
    ]
    rows: Rows = []
    for record in told:
        verdict, truth, true = record.object_verdict, record.metrics["mean"], results.oracle.get(record.scene)
        values = [
            (100 * verdict["disagreement"], 1),
            (verdict["surprise"], 1),
            (verdict["expected_psnr"], 1),
            (truth["relight_psnr_scaled"], 1),
            (None if true is None else true.metrics["mean"].get("relight_psnr_scaled"), 1),
            (truth.get("base_color_ratio"), 2),
            (_spheres_expected(record), 3),
            (_spheres(record), 3),
            (None if true is None else _spheres(true), 3),
        ]
        rows.append(
            ([record.scene, str(record.seed), verdict["trust"], *(number(*v) for v in values)], record)
        )
    head = ["scene", "seed", "verdict", "disagreement, %", "surprise", "relighting expected, dB", "found, dB"]
    head += ["true object's, dB", "base colour over truth", "spheres expected", "found"]
    head += ["true object's spheres"]
    return [*rows_table(results, head, rows), *_agreement(told)]


def _agreement(told: Sequence[Record]) -> list[str]:
    """Return how well the verdicts' order is that of the truth, and how far their decibels are off."""
    fewest = 4  # objects that an order can be told of
    if len(told) < fewest:
        return []
    expected = [record.object_verdict["expected_psnr"] for record in told]
    found = [record.metrics["mean"]["relight_psnr_scaled"] for record in told]
    misses = [abs(a - b) for a, b in zip(expected, found, strict=True)]
    sentence = (
        f"Rank correlation (Spearman) of expected and found relighting over {len(told)} objects: "
        f"{number(_rank_correlation(expected, found), 2)}; mean miss {number(mean(misses), 1)} dB, worst "
        f"{number(max(misses), 1)} dB."
    )
    pairs = [(_spheres_expected(record), _spheres(record)) for record in told]
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    if len(known) >= fewest:
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
    found = [scores[key] for key in _RMSE if key in scores]
    return mean(found) if len(found) == len(SPHERES) else None


def record_table(results: BenchResults) -> list[str]:
    """Return how each record was made."""
    rows = []
    for r in results.records:
        made = [value or NONE for value in (r.commit, r.trained, r.preset)]
        rows.append([r.name, *made, str(r.seed), r.machine, r.threads, f"`{r.command}`"])
    head = ["record", "commit", "trained at", "preset", "seed", "machine", "threads", "command"]
    return markdown_table(head, rows) if rows else []


def results_page(results: BenchResults) -> str:
    """Return RESULTS.md."""
    lines = ["# Results", "", _HEAD, "", *_about(results)]
    if results.missing:
        lines += ["", *(f"**Missing:** {sentence}" for sentence in results.missing)]
    losses_scene = next((record.scene for records in results.losses.values() for record in records), "")
    for title, note, table in _SECTIONS:
        made = table(results)
        if made:
            lines += ["", f"## {title}", "", note.format(losses_scene=losses_scene), "", *made]
    return "\n".join(lines) + "\n"


def _about(results: BenchResults) -> list[str]:
    """Return what the records have in common, or all that they have."""
    lines = []
    for key in ("commit", "machine", "threads", "preset"):
        values = dict.fromkeys(getattr(record, key) for record in results.records if getattr(record, key))
        lines += [f"- {key}: {' and '.join(values)}"] if values else []
    return [*lines, "- records of several commits: each row tells its own"] if results.mixed else lines


_HEAD = (
    "Written by `python -m benchmarks tables` from the records in `records/`, one small file for every evaluation; what is said "
    "about the numbers stands in docs/decisions. Means over test photos come with ± the half width of their 95 % "
    "interval. Photos under one environment are no independent evidence, so lights are the unit: Student's t with one "
    "degree of freedom less than there are lights (see Scenes), and a standard error that takes the photos under one "
    "light together; where the lights have no names, every photo is taken for a light of its own. These intervals are "
    "for the run at hand; what other seeds of the training do stands in a table of its own, where there are such runs."
)
_SECTIONS: tuple[tuple[str, str, Callable[[BenchResults], list[str]]], ...] = (
    (
        "Scenes",
        "What each scene was used for. Numbers of development scenes are of photos that settings were chosen by, and "
        "flatter us; those of untouched scenes and of your own do not.",
        scene_table,
    ),
    (
        "Images",
        "Protocol A: the light is predicted from the whole test photo and the object rendered under it; sRGB, composited "
        "on white. Unseen is protocol B: the light from one half of the object's pixels, scored on the other, mean of four "
        f"splits. `{PAPER_METHOD}` is the paper's network; *{PAPER_METHOD}, quick* was trained with the preset quick's "
        "Phase I, losses, steps and lessons, which are not the paper's. Rows named *paper's settings* come from a run of "
        "its own with the preset paper and as many of the paper's iterations as the row says. Methods scored on a part of "
        "the photos have a table of their own below.",
        image_table,
    ),
    (
        "Images beside the paper's (Table 3)",
        "Full frame, PSNR and SSIM. The paper tells neither its test photos nor what stands behind the object; ours are "
        "every 16th photo, composited on white, at the photos' full size. All of the paper's tables stand in "
        "docs/paper-tables.md.",
        published_images_table,
    ),
    (
        "Light",
        "Relit: the object (the true one where the scene brings it) in other views under the predicted against the true "
        "light, PSNR of its pixels, raw and after one factor per channel. Diffuse, matte, mirror: three-sphere si-RMSE and "
        "mean angle. Log-RMSE of radiance by solid angle, raw, after one factor, after one per channel; brightest: over "
        "the brightest percent of the true light's solid angle alone, raw and after the whole map's one factor. *True "
        "object*: the scene's own mesh and material in place of the reconstructed ones; the learned methods keep the model "
        "of the training that the last table names for these rows, which can be an earlier one than the run's.",
        light_table,
    ),
    (
        "Light beside published numbers",
        "The three spheres (si-RMSE and mean angle) in the mean of all scenes whose true lights are known, beside "
        "published ones. The measure is the same; photos, lights and what is known beforehand are not, so the rows tell "
        "where ours stands, not which method is better.",
        published_lights_table,
    ),
    (
        "The default over training seeds",
        "Both phases trained anew with every seed, the default method on all test photos: mean over seeds ± the half width "
        "of its 95 % interval over seeds (Student's t), and the least and the largest.",
        seed_table,
    ),
    (
        f"The default against `{PAPER_METHOD}`",
        f"The default of the run against `{PAPER_METHOD}`: trained with the preset quick on the same lessons, on photos "
        "alone, and in a run of its own with the paper's settings and the stated part of its iterations. Only the last is "
        "the paper's method, and only with all its iterations its result. Gains in dB; ratios of three-sphere si-RMSE and "
        "differences of log-RMSE, where less than 1 and less than 0 are better.",
        comparison_table,
    ),
    (
        "What Phase II learns from",
        "Other Phases II on the same Phase I. *As trained*: on photos under their lights from Phase I and on re-rendered "
        "ones, under those lights turned, tinted and mixed and under generated ones. *Photos alone*: the paper's kind of "
        "lessons. *Re-rendered alone*: without the photos. *With HDRIs*: as trained, but about half of the re-rendered "
        "photos lit by the environment maps of a folder.",
        lessons_table,
    ),
    (
        "Against slow methods, on the same few photos",
        "Methods that take more than 20 s a photo are scored on the first photos only, as many as the row says, and the "
        "default beside them on the same ones. So few photos carry no interval.",
        slow_table,
    ),
    (
        "The object",
        "Base colour over truth: ratio of the mean linear base colours over all pixels that both objects cover, geometric "
        "mean over channels, and the channel that is farthest from 1. Base colour in dB, raw and after one factor per "
        "channel. Relighting: the object under the scene's novel lights against its renders, PSNR and SSIM of its pixels, "
        "raw and after one factor per channel. The rows of true objects show what is left to the renderer.",
        object_table,
    ),
    (
        "What was said of the object beforehand",
        "The verdict of training on its object, from held-out photos alone (docs/decisions/object-verdict.md), beside what "
        "truth says: disagreement of darker and brighter parts about the light, surprise at where the lights come from in "
        "ln probability, relighting after one factor per channel as it was expected and as it was found, and the mean "
        "si-RMSE of the three spheres under the default's maps, as simulated photos of the object let expect, whose lights "
        "are coarser (docs/decisions/light-accuracy.md), and as it was found. Beside both stands what the true object "
        "comes to: more cannot be expected of any. How bright the object is as a whole the verdict hardly sees.",
        verdict_table,
    ),
    (
        "Error by confidence",
        "All directions of all test photos in five parts of equal solid angle by confidence: log-RMSE after one factor per "
        "photo (raw in brackets).",
        confidence_table,
    ),
    (
        "Seconds per photo (Table 4)",
        "Prediction of one photo, in process, assets loaded, in the mean of the photos that the method saw; training of "
        "the run, and the most memory, as its log has it.",
        time_table,
    ),
    (
        "Weights of the loss (Table 5), and r² against r⁴",
        f"`{PAPER_METHOD}` on {{losses_scene}}: one Phase I, Phase II trained anew for every loss and seed. "
        "Means, ± the half width of the 95 % interval over seeds (Student's t).",
        loss_table,
    ),
    (
        "How each record was made",
        "Commit: what evaluated; trained at: what trained, where the benchmark did that itself. DATA stands for the folder "
        "of the scenes, RUNS for that of the runs, FOLDER for the benchmark's own, HDRI for the environment maps. "
        "`python -m benchmarks tables` writes this page from the records.",
        record_table,
    ),
)


@dataclass(frozen=True)
class Tables:
    """Where the records are and where the pages go."""

    records: Path = RECORDS
    """Folder of the records."""
    results: Path = RESULTS
    """The page of results."""
    paper: Path | None = None
    """A page that sets every table of the paper beside ours, such as docs/paper-tables.md."""


def write_pages(where: Tables, scenes: Sequence[str] = ()) -> None:
    """Write the pages; `scenes` without a record are named. Raises `ConfigError` where there is no record."""
    found = read_records(where.records)
    if not found:
        raise ConfigError(
            f"There is no record in {where.records}; tell where the records are with --records DIR."
        )
    scored = {record.scene for record in found if record.kind is Kind.RUN}
    missing = [f"{name}, for which there are no numbers." for name in scenes if name not in scored]
    results = BenchResults(found, missing)
    write_bytes(where.results, results_page(results).encode())
    if where.paper is not None:
        write_bytes(where.paper, paper_page(results).encode())


def main(words: Sequence[str]) -> None:
    """Read the command line and write the pages."""
    where = tyro.cli(Tables, description="Write the pages from the records alone.", args=words)
    write_pages(where)
    print(f"Results: {where.results}" + (f"\nThe paper's tables: {where.paper}" if where.paper else ""))

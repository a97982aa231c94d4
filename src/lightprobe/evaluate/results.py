"""The tables of a benchmark as one Markdown page, from the numbers of its pieces."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from lightprobe.evaluate.metrics import interval

Metrics = dict[str, Any]  # the content of a metrics.json
PAPER_METHOD = "probe-mlp"
PAPER_LESSONS = "photos alone"
_AS_TRAINED = "as trained"
SPHERES = ("diffuse", "matte", "mirror")
PUBLISHED_SCENES = ("spot", "bottle")  # lit as the scenes of the published numbers
PUBLISHED_SI_RMSE = (0.077, 0.196, 0.442)  # of SPHERES, the best under such lights


@dataclass
class BenchResults:
    """What a benchmark has found so far; anything may still be missing."""

    about: dict[str, str]  # commit, machine, seed, preset, ...
    scenes: dict[str, Metrics] = field(default_factory=dict)
    oracle: dict[str, Metrics] = field(default_factory=dict)  # the same with the true object
    training: dict[str, dict[str, float]] = field(default_factory=dict)  # scene -> phase -> seconds
    losses: dict[str, list[Metrics]] = field(default_factory=dict)  # variant -> one per seed
    losses_scene: str = ""
    commands: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)  # sentences
    lessons: dict[str, dict[str, Metrics]] = field(default_factory=dict)  # other lessons of Phase II -> scene


def results_page(results: BenchResults) -> str:
    """Return the page."""
    sections = [
        ("Images", _IMAGES_NOTE, image_table(results)),
        ("Light", _LIGHT_NOTE, light_table(results)),
        ("", _PUBLISHED_NOTE, published_table(results)),
        ("The default against the paper's method", _DEFAULT_NOTE, comparison_table(results)),
        ("What Phase II learns from", _LESSONS_NOTE, lessons_table(results)),
        ("Against slow methods, on the same photos", "", slow_table(results)),
        ("The object", _OBJECT_NOTE, object_table(results)),
        ("Error by confidence", _CONFIDENCE_NOTE, confidence_table(results)),
        ("Seconds per photo (Table 4)", _TIME_NOTE, time_table(results)),
        ("Weights of the loss (Table 5), and r² against r⁴", _loss_note(results), loss_table(results)),
    ]
    lines = ["# Results", "", _HEAD, ""]
    lines += [f"- {name}: {value}" for name, value in results.about.items()]
    if results.missing:
        lines += ["", *(f"**Missing:** {sentence}" for sentence in results.missing)]
    for title, note, table in sections:
        if table:
            lines += [*(["", f"## {title}"] if title else []), *(["", note] if note else []), "", *table]
    lines += ["", "## Commands", "", _COMMANDS_NOTE, "", *(f"    {command}" for command in results.commands)]
    return "\n".join(lines) + "\n"


def image_table(results: BenchResults) -> list[str]:
    """Return PSNR and SSIM under protocols A and B, method by scene."""
    columns = {"psnr": 2, "ssim": 3, "psnr_masked": 2, "ssim_masked": 3, "psnr_unseen": 2}
    heads = ["PSNR", "SSIM", "PSNR object", "SSIM object", "PSNR unseen"]
    return _method_table(heads, columns, results.scenes, [(results.scenes, "")])


def light_table(results: BenchResults) -> list[str]:
    """Return the errors of the lights, method by scene, with the rows of the true object below."""
    columns = {
        "relit_psnr": 2, "relit_psnr_scaled": 2, **{f"{s}_si_rmse": 3 for s in SPHERES},
        **{f"{s}_angular": 1 for s in SPHERES}, "light_log_rmse": 2, "light_log_rmse_scaled": 2,
        "light_log_rmse_channels": 2,
    }  # fmt: skip
    heads = ["relit", "scaled", *SPHERES, *(f"{s} °" for s in SPHERES), "log-RMSE", "scaled", "per channel"]
    known = {name: m for name, m in results.scenes.items() if _has(m, "light_log_rmse")}
    return _method_table(heads, columns, known, _sources(results))


def published_table(results: BenchResults) -> list[str]:
    """Return the default's three spheres in the mean of the scenes that published numbers can be held against."""
    columns = {**{f"{s}_si_rmse": 3 for s in SPHERES}, **{f"{s}_angular": 1 for s in SPHERES}}
    lights = [("default" + (mark or ", own object"), _picked(source)) for source, mark in _sources(results)]
    rows = []
    for label, scores in [*lights, ("constant map", _picked(results.scenes, "constant"))]:
        if len(scores) == len(PUBLISHED_SCENES):
            means = {key: _mean([each[key] for each in scores]) for key in columns if all(key in s for s in scores)}
            rows.append([label, *_cells(means, {}, columns)])
    published = dict(zip(columns, PUBLISHED_SI_RMSE, strict=False))  # angles are not published
    rows.append(["best published", *_cells(published, {}, columns)])
    return _table(["light", *SPHERES, *(f"{s} °" for s in SPHERES)], rows) if len(rows) > 1 else []


def _picked(source: dict[str, Metrics], method: str | None = None) -> list[dict[str, float]]:
    """Return a method's scores, by default the default's, on those of the compared scenes whose lights are known."""
    found = [source[name] for name in PUBLISHED_SCENES if name in source]
    scores = [metrics["methods"].get(method or metrics["default_method"], {}) for metrics in found]
    return [each for each in scores if f"{SPHERES[0]}_si_rmse" in each]


def comparison_table(results: BenchResults) -> list[str]:
    """Return what the default gains over the paper's method, trained alike and as in the paper, and the means."""
    rows = []
    for lessons, papers in ((_AS_TRAINED, results.scenes), (PAPER_LESSONS, results.lessons.get(PAPER_LESSONS, {}))):
        rows += [[name, lessons, *cells] for name, cells in _gains(results.scenes, papers)]
    return _table(["scene", "lessons", *_GAINS], rows) if rows else []


def _gains(scored: dict[str, Metrics], papers: dict[str, Metrics]) -> list[tuple[str, list[str]]]:
    """Return (scene, cells under `_GAINS`) of the default in `scored` against the paper's method in `papers`.

    Only scenes with known lights; below more than one stands their mean.
    """
    rows: list[tuple[str, list[float]]] = []
    for name, metrics in scored.items():
        default, paper = _default(metrics), papers.get(name, {}).get("methods", {}).get(PAPER_METHOD, {})
        if not paper or "relit_psnr_scaled" not in default:
            continue
        keys = ("relit_psnr_scaled", "psnr_masked", "psnr_unseen")
        gains = [default[k] - paper[k] if k in paper and k in default else math.nan for k in keys]
        rows.append((name, gains + [default[f"{s}_si_rmse"] / paper[f"{s}_si_rmse"] for s in SPHERES]))
    if len(rows) > 1:
        means = [_mean(values) for values in zip(*(values for _, values in rows), strict=True)]
        rows.append(("**mean**", means))
    return [(name, [*map(_signed, values[:3]), *(f"{v:.2f}" for v in values[3:])]) for name, values in rows]


def lessons_table(results: BenchResults) -> list[str]:
    """Return the learned methods after each kind of lessons, on every scene that has more than one."""
    columns = {
        "psnr_masked": 2, "psnr_unseen": 2, "relit_psnr_scaled": 2, **{f"{s}_si_rmse": 3 for s in SPHERES},
        "light_log_rmse_scaled": 2,
    }  # fmt: skip
    every = {_AS_TRAINED: results.scenes, **results.lessons}
    rows = []
    for name in results.scenes:
        found = {kind: scenes[name] for kind, scenes in every.items() if name in scenes}
        if len(found) < 2:
            continue
        for method in list(found.values())[-1]["methods"]:
            for kind, metrics in found.items():
                scores, around = metrics["methods"].get(method, {}), metrics.get("interval", {}).get(method, {})
                rows.append([name, method, kind, *_cells(scores, around, columns)])
    head = ["scene", "method", "lessons", "PSNR object", "PSNR unseen", "relit, scaled", *SPHERES, "log-RMSE, scaled"]
    return _table(head, rows) if rows else []


def slow_table(results: BenchResults) -> list[str]:
    """Return the default method beside every method that was scored on a part of the photos, on that part."""
    keys = {"psnr_masked": 2, "psnr_unseen": 2, "relit_psnr_scaled": 2, "mirror_si_rmse": 3, "seconds": 2}
    rows = []
    for name, metrics in results.scenes.items():
        photos = [photo["methods"] for photo in metrics["photos"].values()]
        for method in metrics["methods"]:
            shared = [each for each in photos if method in each]
            if not 0 < len(shared) < len(photos):
                continue
            for which in (metrics["default_method"], method):
                values = [[each[which][key] for each in shared if key in each[which]] for key in keys]
                cells = [_number(_mean(v), d) if v else "–" for v, d in zip(values, keys.values(), strict=True)]
                rows.append([name, f"{which} ({len(shared)} photos)", *cells])
    head = ["scene", "method", "PSNR object", "PSNR unseen", "relit, scaled", "mirror", "seconds"]
    return _table(head, rows) if rows else []


def object_table(results: BenchResults) -> list[str]:
    """Return the reconstructed objects against the truth, and how the true ones fare in our renderer."""
    keys = {
        "chamfer": 4, "roughness_mae": 3, "metallic_mae": 3, "normal_degrees": 1, "base_color_psnr": 1,
        "base_color_psnr_scaled": 1, "relight_psnr": 1, "relight_psnr_scaled": 1, "relight_ssim_scaled": 3,
    }  # fmt: skip
    rows = []
    for source, mark in ((results.scenes, ""), (results.oracle, ", true object")):
        for name, metrics in source.items():
            if "relight_psnr" in metrics["mean"] or "chamfer" in metrics["mean"]:
                rows.append([name + mark, *_cells(metrics["mean"], {}, keys)])
    head = ["scene", "Chamfer", "roughness", "metallic", "normals °", "base colour", "scaled", "relighting", "scaled"]
    return _table([*head, "SSIM"], rows) if rows else []


def confidence_table(results: BenchResults) -> list[str]:
    """Return the log-RMSE in the five bins of confidence, and whether it falls."""
    rows = []
    for source, mark in _sources(results):
        for name, metrics in source.items():
            for method, checked in metrics.get("confidence", {}).items():
                bins = checked["bins"]
                errors = [f"{part['log_rmse_scaled']:.2f} ({part['log_rmse']:.2f})" for part in bins]
                trust = f"{bins[0]['confidence']:.2f} to {bins[-1]['confidence']:.2f}"
                rows.append([name + mark, method, *errors, trust, "yes" if checked["falls"] else "**no**"])
    head = ["scene", "method", "least", "2", "3", "4", "most", "confidence", "falls"]
    return _table(head, rows) if rows else []


def time_table(results: BenchResults) -> list[str]:
    """Return the seconds per photo of each method, and the seconds of both phases of training."""
    methods = list(dict.fromkeys(method for m in results.scenes.values() for method in m["methods"]))
    rows = []
    for name, metrics in results.scenes.items():
        seconds = [_number(metrics["methods"].get(method, {}).get("seconds"), 2) for method in methods]
        phases = [_number(results.training.get(name, {}).get(phase), 0) for phase in ("decompose", "distill")]
        rows.append([name, *seconds, *phases, _number(results.training.get(name, {}).get("memory"), 2)])
    return _table(["scene", *methods, "Phase I, s", "Phase II, s", "GiB"], rows) if rows else []


def loss_table(results: BenchResults) -> list[str]:
    """Return the variants of Phase II with means and 95 % intervals over seeds."""
    keys = {
        "psnr": 2, "ssim": 4, "psnr_masked": 2, "relit_psnr_scaled": 2, **{f"{s}_si_rmse": 4 for s in SPHERES},
        "light_log_rmse_scaled": 3,
    }  # fmt: skip
    rows = []
    for variant, seeds in results.losses.items():
        means = [metrics["methods"][PAPER_METHOD] for metrics in seeds]
        values = {key: [m[key] for m in means if key in m] for key in keys}
        cells = [_mean_cell(values[key], decimals) for key, decimals in keys.items()]
        rows.append([variant, str(len(seeds)), *cells])
    head = ["loss", "seeds", "PSNR", "SSIM", "PSNR object", "relit, scaled", *SPHERES, "log-RMSE, scaled"]
    return _table(head, rows) if rows else []


def _sources(results: BenchResults) -> list[tuple[dict[str, Metrics], str]]:
    """Return both kinds of evaluation with what their rows add to the scene's name."""
    return [(results.scenes, ""), (results.oracle, ", true object")]


def _default(metrics: Metrics) -> dict[str, float]:
    scores: dict[str, float] = metrics["methods"][metrics["default_method"]]
    return scores


def _method_table(
    heads: list[str], columns: dict[str, int], scenes: Iterable[str], sources: Sequence[tuple[dict[str, Metrics], str]]
) -> list[str]:
    rows = []
    for name in scenes:
        for source, mark in sources:
            for method, scores in source.get(name, {}).get("methods", {}).items():
                around = source[name].get("interval", {}).get(method, {})
                rows.append([name + mark, method, *_cells(scores, around, columns)])
    return _table(["scene", "method", *heads], rows) if rows else []


def _cells(scores: dict[str, float], around: dict[str, float], columns: dict[str, int]) -> list[str]:
    cells = []
    for key, decimals in columns.items():
        margin = f" ± {_number(around[key], decimals)}" if key in around else ""
        cells.append(_number(scores.get(key), decimals) + margin)
    return cells


def _mean_cell(values: Sequence[float], decimals: int) -> str:
    if not values:
        return "–"
    margin = interval(values)
    return _number(_mean(values), decimals) + (f" ± {_number(margin, decimals)}" if math.isfinite(margin) else "")


def _number(value: float | None, decimals: int) -> str:
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{decimals}f}"
    return text.replace("0.", ".", 1) if text.startswith("0.") else text


def _signed(value: float) -> str:
    return f"{value:+.2f}" if math.isfinite(value) else "–"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    marks = ["---" if i == 0 or name in ("method", "lessons") else "---:" for i, name in enumerate(head)]
    return [f"| {' | '.join(cells)} |" for cells in (head, marks, *rows)]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _has(metrics: Metrics, key: str) -> bool:
    return any(key in scores for scores in metrics["methods"].values())


def _loss_note(results: BenchResults) -> str:
    return (
        f"`{PAPER_METHOD}` on {results.losses_scene}: one Phase I, Phase II trained anew for every loss and seed. "
        "Means, ± the half width of the 95 % interval over seeds."
    )


_HEAD = (
    "Written by `lightprobe bench`; what is said about the numbers stands in NOTES.md. Every mean over test photos "
    "comes with ± the half width of its 95 % interval (Student's t)."
)
_IMAGES_NOTE = (
    "Protocol A: the light is predicted from the whole test photo and the object rendered under it; sRGB, composited "
    "on white. Unseen is protocol B: the light from one half of the object's pixels, scored on the other, mean of four "
    "splits."
)
_LIGHT_NOTE = (
    "Relit: the object (the true one where the scene brings it) in other views under the predicted against the true "
    "light, PSNR of its pixels, raw and after one factor per channel. Diffuse, matte, mirror: three-sphere si-RMSE and "
    "mean angle. Log-RMSE of radiance by solid angle, raw, after one factor, after one per channel. *True object*: the "
    "scene's own mesh and material in place of the reconstructed ones; the learned methods keep the run's model."
)
_PUBLISHED_NOTE = (
    f"The three spheres in the mean of {' and '.join(PUBLISHED_SCENES)}, beside the best that is published for such "
    "lights, on other photos."
)
_GAINS = ["relit, dB", "object, dB", "unseen, dB", *(f"{s}, ratio" for s in SPHERES)]
_DEFAULT_NOTE = (
    f"The default against `{PAPER_METHOD}`, trained on the same lessons and, as in the paper, on photos alone. Gains "
    "in dB; ratios of three-sphere si-RMSE, less than 1 is better."
)
_LESSONS_NOTE = (
    "Other Phases II on the same Phase I. *As trained*: on photos under their lights from Phase I and on re-rendered "
    "ones, under those lights turned, tinted and mixed and under generated ones. *Photos alone*: the paper's lessons. "
    "*Re-rendered alone*: without the photos. *With HDRIs*: as trained, but about half of the re-rendered photos lit "
    "by the environment maps of a folder."
)
_COMMANDS_NOTE = (
    "DATA stands for the folder of the scenes, RUNS for that of the runs, FOLDER for the benchmark's own, HDRI for the "
    "environment maps."
)
_OBJECT_NOTE = (
    "Relighting: the object under the scene's novel lights against its renders, PSNR of its pixels, raw and after one "
    "factor per channel. The rows of true objects show what is left to the renderer."
)
_CONFIDENCE_NOTE = (
    "All directions of all test photos in five parts of equal solid angle by confidence: log-RMSE after one factor per "
    "photo (raw in brackets)."
)
_TIME_NOTE = (
    "Prediction of one photo, in process, assets loaded; training of the run, and the most memory, as its log has it."
)

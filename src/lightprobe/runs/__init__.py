"""Runs as a library: a folder of photos in, a run folder out, and what is done with a run from then on.

    run = train_run("photos/cup", "runs/cup", preset=Preset.QUICK)
    evaluate_run(run.path)

Names are loaded when first used: a prediction need not wait for what only a training imports.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lightprobe.runs.bench import BenchOptions, run_bench, write_pages
    from lightprobe.runs.calibration import (
        Point,
        calibrate_by_albedo,
        calibrate_by_light,
        calibrate_by_meter,
        reset_calibration,
    )
    from lightprobe.runs.evaluation import EvaluatedRun, EvaluationOptions, evaluate_run
    from lightprobe.runs.outputs import export_run, relight_run, render_run
    from lightprobe.runs.pages import compare_runs, write_gallery
    from lightprobe.runs.preparing import prepare_scene
    from lightprobe.runs.progress import OnProgress
    from lightprobe.runs.training import distill_run, fit_run, train_run

__all__ = [
    "BenchOptions",
    "EvaluatedRun",
    "EvaluationOptions",
    "OnProgress",
    "Point",
    "calibrate_by_albedo",
    "calibrate_by_light",
    "calibrate_by_meter",
    "compare_runs",
    "distill_run",
    "evaluate_run",
    "export_run",
    "fit_run",
    "prepare_scene",
    "relight_run",
    "render_run",
    "reset_calibration",
    "run_bench",
    "train_run",
    "write_gallery",
    "write_pages",
]

_HOME = {
    "BenchOptions": "bench",
    "EvaluatedRun": "evaluation",
    "EvaluationOptions": "evaluation",
    "OnProgress": "progress",
    "Point": "calibration",
    "calibrate_by_albedo": "calibration",
    "calibrate_by_light": "calibration",
    "calibrate_by_meter": "calibration",
    "compare_runs": "pages",
    "distill_run": "training",
    "evaluate_run": "evaluation",
    "export_run": "outputs",
    "fit_run": "training",
    "prepare_scene": "preparing",
    "relight_run": "outputs",
    "render_run": "outputs",
    "reset_calibration": "calibration",
    "run_bench": "bench",
    "train_run": "training",
    "write_gallery": "pages",
    "write_pages": "bench",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"lightprobe.runs.{_HOME[name]}"), name)
    raise AttributeError(f"module 'lightprobe.runs' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

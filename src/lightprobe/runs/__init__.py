"""Runs as a library: a folder of photos in, a run folder out, and what is done with a run from then on.

run = training.train_run("photos/cup", "runs/cup", preset=Preset.QUICK)
evaluation.evaluate_run(run.path)
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lightprobe.jobs.insertion import InsertedObject, insert_object
    from lightprobe.runs.calibration import (
        Point,
        calibrate_by_albedo,
        calibrate_by_light,
        calibrate_by_meter,
        reset_calibration,
    )
    from lightprobe.runs.evaluation import EvaluatedRun, EvaluationOptions, evaluate_run
    from lightprobe.runs.locations import LocationFiles, locate_photos
    from lightprobe.runs.outputs import export_run, relight_run, render_run
    from lightprobe.runs.pages import compare_runs, write_gallery
    from lightprobe.runs.predictions import PredictionFiles, predict_one_light, predict_photos
    from lightprobe.runs.preparing import prepare_scene
    from lightprobe.runs.progress import OnProgress
    from lightprobe.runs.training import distill_run, fit_run, train_run
    from lightprobe.runs.videos import predict_video, predict_video_light

__all__ = [
    "EvaluatedRun",
    "EvaluationOptions",
    "InsertedObject",
    "LocationFiles",
    "OnProgress",
    "Point",
    "PredictionFiles",
    "calibrate_by_albedo",
    "calibrate_by_light",
    "calibrate_by_meter",
    "compare_runs",
    "distill_run",
    "evaluate_run",
    "export_run",
    "fit_run",
    "insert_object",
    "locate_photos",
    "predict_one_light",
    "predict_photos",
    "predict_video",
    "predict_video_light",
    "prepare_scene",
    "relight_run",
    "render_run",
    "reset_calibration",
    "train_run",
    "write_gallery",
]

_HOME = {
    "EvaluatedRun": "evaluation",
    "EvaluationOptions": "evaluation",
    "InsertedObject": "insertion",
    "LocationFiles": "locations",
    "OnProgress": "progress",
    "Point": "calibration",
    "PredictionFiles": "predictions",
    "calibrate_by_albedo": "calibration",
    "calibrate_by_light": "calibration",
    "calibrate_by_meter": "calibration",
    "compare_runs": "pages",
    "distill_run": "training",
    "evaluate_run": "evaluation",
    "export_run": "outputs",
    "fit_run": "training",
    "insert_object": "insertion",
    "locate_photos": "locations",
    "predict_one_light": "predictions",
    "predict_photos": "predictions",
    "predict_video": "videos",
    "predict_video_light": "videos",
    "prepare_scene": "preparing",
    "relight_run": "outputs",
    "render_run": "outputs",
    "reset_calibration": "calibration",
    "train_run": "training",
    "write_gallery": "pages",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"lightprobe.runs.{_HOME[name]}"), name)
    raise AttributeError(f"module 'lightprobe.runs' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

"""Predictions and photos in, metrics, tables and the report out."""

from lightprobe.evaluate.evaluation import Evaluation, Protocols, ViewResult, evaluate
from lightprobe.evaluate.oracle import can_be_oracle, oracle_decomposition
from lightprobe.evaluate.pictures import view_pictures
from lightprobe.evaluate.prediction_files import write_prediction
from lightprobe.evaluate.relighting import load_environment, relight
from lightprobe.evaluate.report import Report, spread, write_report
from lightprobe.evaluate.viewpoints import turntable

__all__ = [
    "Evaluation",
    "Protocols",
    "Report",
    "ViewResult",
    "can_be_oracle",
    "evaluate",
    "load_environment",
    "oracle_decomposition",
    "relight",
    "spread",
    "turntable",
    "view_pictures",
    "write_prediction",
    "write_report",
]

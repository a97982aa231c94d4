"""Predictions and photos in, metrics, tables and the report out."""

from lightprobe.evaluation.evaluation import Evaluation, Protocols, ViewResult, evaluate
from lightprobe.evaluation.oracle import can_be_oracle, oracle_decomposition
from lightprobe.evaluation.pictures import view_pictures
from lightprobe.evaluation.prediction_files import write_prediction
from lightprobe.evaluation.relighting import load_environment, relight
from lightprobe.evaluation.report import Report, spread, write_report
from lightprobe.evaluation.viewpoints import turntable

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

"""Predictions, photos and the truth in, numbers out."""

from lightprobe.evaluation.evaluation import Evaluation, Protocols, ViewResult, evaluate, write_prediction
from lightprobe.evaluation.oracle import can_be_oracle, oracle_decomposition
from lightprobe.evaluation.relighting import Relighter, relight, turntable

__all__ = [
    "Evaluation",
    "Protocols",
    "Relighter",
    "ViewResult",
    "can_be_oracle",
    "evaluate",
    "oracle_decomposition",
    "relight",
    "turntable",
    "write_prediction",
]

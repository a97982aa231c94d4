"""One photo, camera and mask in, an environment map with a confidence for every direction out."""

from lightprobe.core.config.prediction import Method, PredictConfig
from lightprobe.prediction.background import BackgroundUse
from lightprobe.prediction.prediction import Prediction, check_names
from lightprobe.prediction.predictor import Predictor, is_fitted, methods_for, recorded_config
from lightprobe.prediction.verdict import PhotoStatus, PhotoVerdict

__all__ = [
    "BackgroundUse",
    "Method",
    "PhotoStatus",
    "PhotoVerdict",
    "PredictConfig",
    "Prediction",
    "Predictor",
    "check_names",
    "is_fitted",
    "methods_for",
    "recorded_config",
]

"""One photo, camera and mask in, an environment map with a confidence for every direction out."""

from lightprobe.predict.prediction import Prediction, check_names
from lightprobe.predict.predictor import Method, Predictor, methods_for

__all__ = ["Method", "Prediction", "Predictor", "check_names", "methods_for"]

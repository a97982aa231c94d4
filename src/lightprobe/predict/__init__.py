"""One photo, camera and mask in, an environment map with a confidence for every direction out."""

from lightprobe.predict.prediction import Prediction, check_names
from lightprobe.predict.predictor import Method, Predictor, methods_for
from lightprobe.predict.verdict import Status, Verdict

__all__ = ["Method", "Prediction", "Predictor", "Status", "Verdict", "check_names", "methods_for"]

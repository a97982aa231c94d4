"""One photo, camera and mask in, an environment map with a confidence for every direction out."""

from lightprobe.predict.predictor import Method, Prediction, Predictor, methods_for

__all__ = ["Method", "Prediction", "Predictor", "methods_for"]

"""Phase II: a `Decomposition` and its photos in, a `ProbeModel` out that predicts light from pixels."""

from lightprobe.distill.probe_model import ProbeModel
from lightprobe.distill.training import distill

__all__ = ["ProbeModel", "distill"]

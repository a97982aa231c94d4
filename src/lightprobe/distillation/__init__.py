"""Phase II: a `Decomposition` and its photos in, a `ProbeModel` out that predicts light from pixels."""

from lightprobe.distillation.training import distill

__all__ = ["distill"]

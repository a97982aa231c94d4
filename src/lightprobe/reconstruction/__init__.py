"""Phase I: a `Scene` in, a `Decomposition` out: mesh, textures and one environment per training photo."""

from lightprobe.reconstruction.phase1 import decompose
from lightprobe.training import Progress
from lightprobe.training.loop import OnStep

__all__ = ["OnStep", "Progress", "decompose"]

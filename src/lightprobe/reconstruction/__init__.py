"""Phase I: a `Scene` in, a `Decomposition` out: mesh, textures and one environment per training photo."""

from lightprobe.reconstruction.optimisation import Progress
from lightprobe.reconstruction.phase1 import decompose

__all__ = ["Progress", "decompose"]

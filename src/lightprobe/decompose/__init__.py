"""Phase I: a `Scene` in, a `Decomposition` out: mesh, textures and one environment per training photo."""

from lightprobe.decompose.decomposition import Decomposition
from lightprobe.decompose.optimisation import Progress
from lightprobe.decompose.phase1 import decompose

__all__ = ["Decomposition", "Progress", "decompose"]

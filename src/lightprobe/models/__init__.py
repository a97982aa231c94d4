"""What training leaves and prediction works with: the decomposed object, and the networks."""

from lightprobe.models.decomposition import Decomposition
from lightprobe.models.light_accuracy import LightAccuracy
from lightprobe.models.object_verdict import ObjectVerdict
from lightprobe.models.probe_model import ProbeModel

__all__ = ["Decomposition", "LightAccuracy", "ObjectVerdict", "ProbeModel"]

"""From plain photos to a scene: cameras, masks and an upright frame."""

from lightprobe.preparation.cache import HIDDEN
from lightprobe.preparation.options import PrepareOptions
from lightprobe.preparation.photos import source_photos
from lightprobe.preparation.preparing import Prepared, check_output, prepare

__all__ = ["HIDDEN", "PrepareOptions", "Prepared", "check_output", "prepare", "source_photos"]

"""From plain photos to a scene: cameras, masks and an upright frame."""

from lightprobe.preparation.options import Masker, PrepareOptions
from lightprobe.preparation.photos import source_photos
from lightprobe.preparation.preparing import Prepared, prepare

__all__ = ["Masker", "PrepareOptions", "Prepared", "prepare", "source_photos"]

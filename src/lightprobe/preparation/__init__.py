"""From plain photos to a scene: cameras, masks and an upright frame."""

from lightprobe.preparation.options import Masker, PrepareOptions
from lightprobe.preparation.photos import is_bare, list_photos
from lightprobe.preparation.preparing import Prepared, prepare

__all__ = ["Masker", "PrepareOptions", "Prepared", "is_bare", "list_photos", "prepare"]

"""Where a new photo was taken from: camera, focal length and mask of a photo of a known object under any
light.
"""

from lightprobe.localization.locator import Located, Locator, locate, stored_views
from lightprobe.localization.verdict import PoseStatus, PoseVerdict
from lightprobe.localization.views import KnownViews

__all__ = ["KnownViews", "Located", "Locator", "PoseStatus", "PoseVerdict", "locate", "stored_views"]

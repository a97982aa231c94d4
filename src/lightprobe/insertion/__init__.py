"""A virtual object of the user's, put into a photo beside the known object and lit by the photo's light."""

from lightprobe.insertion.compositing import Insertion, LayerFiles, PhotoView, insert
from lightprobe.insertion.placement import Placement
from lightprobe.insertion.virtual_object import VirtualObject, load_virtual_object

__all__ = [
    "Insertion",
    "LayerFiles",
    "PhotoView",
    "Placement",
    "VirtualObject",
    "insert",
    "load_virtual_object",
]

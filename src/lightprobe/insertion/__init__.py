"""A thing of the user's, put into a photo beside the known object and lit by the photo's light."""

from lightprobe.insertion.compositing import PhotoView, insert
from lightprobe.insertion.layers import Insertion
from lightprobe.insertion.placement import Wish
from lightprobe.insertion.thing import Thing, load_thing

__all__ = ["Insertion", "PhotoView", "Thing", "Wish", "insert", "load_thing"]

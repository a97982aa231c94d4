"""A folder of photos in, a `Scene` out: cameras, masks, splits and the similarity to the normalised frame."""

from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.hull import Hull, carved_hull, visual_hull
from lightprobe.scene.loading import load_scene
from lightprobe.scene.new_photo import load_photo, new_photo, read_camera
from lightprobe.scene.photo import Photo, Pixels, Scene, Truth
from lightprobe.scene.pixels import load_alpha, load_pixels

__all__ = [
    "Camera",
    "Hull",
    "Photo",
    "Pixels",
    "Scene",
    "Similarity",
    "Truth",
    "carved_hull",
    "load_alpha",
    "load_photo",
    "load_pixels",
    "load_scene",
    "new_photo",
    "read_camera",
    "visual_hull",
]

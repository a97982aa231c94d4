"""Image files in, linear float pixels out, and back; sizes are checked before anything is decoded."""

from lightprobe.core import first_calls  # noqa: F401  (its import is its work)
from lightprobe.imaging.color import LUMA, srgb_decode, srgb_encode
from lightprobe.imaging.decoding import foreign_encoding
from lightprobe.imaging.exif import focal_ratio, gravity, read_exif_ev100, read_orientation, turned_size, undo
from lightprobe.imaging.hdr import read_hdr, write_exr
from lightprobe.imaging.ldr import (
    alpha_range,
    image_size,
    read_alpha,
    read_ldr,
    read_mask,
    read_photo,
    write_mask,
    write_png,
)
from lightprobe.imaging.limits import MAX_PIXELS, check_memory, worked_size
from lightprobe.imaging.opening import IMAGE_SUFFIXES, RAW_SUFFIXES, VIDEO_SUFFIXES
from lightprobe.imaging.photo_file import CLIPPED, PhotoFile
from lightprobe.imaging.profiles import UNREADABLE
from lightprobe.imaging.radiance import write_radiance
from lightprobe.imaging.resize import resize_area, resize_rows, shrink_area
from lightprobe.imaging.video import extract_frames, is_video

__all__ = [
    "CLIPPED",
    "IMAGE_SUFFIXES",
    "LUMA",
    "MAX_PIXELS",
    "RAW_SUFFIXES",
    "UNREADABLE",
    "VIDEO_SUFFIXES",
    "PhotoFile",
    "alpha_range",
    "check_memory",
    "extract_frames",
    "focal_ratio",
    "foreign_encoding",
    "gravity",
    "image_size",
    "is_video",
    "read_alpha",
    "read_exif_ev100",
    "read_hdr",
    "read_ldr",
    "read_mask",
    "read_orientation",
    "read_photo",
    "resize_area",
    "resize_rows",
    "shrink_area",
    "srgb_decode",
    "srgb_encode",
    "turned_size",
    "undo",
    "worked_size",
    "write_exr",
    "write_mask",
    "write_png",
    "write_radiance",
]

"""Files that are no photos of a kind that is read: one sentence with file, cause and remedy."""

import re

import imagecodecs
import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import IMAGE_SUFFIXES, image_size, read_ldr, read_mask

PICTURE = np.full((16, 24, 3), (200, 120, 60), np.uint8)
SAVE = "save it as PNG, or as TIFF with 16 bits."
KINDS = {
    "a.bmp": "is a BMP image, which is not read; " + SAVE,
    "a.gif": "is a GIF image, which is not read; " + SAVE,
    "a.jp2": "is a JPEG 2000 image, which is not read; " + SAVE,
    "a.j2k": "is a JPEG 2000 image, which is not read; " + SAVE,
    "a.jxl": "is a JPEG XL image, which is not read; " + SAVE,
    "boxed.jxl": "is a JPEG XL image, which is not read; " + SAVE,
    "a.qoi": "is a QOI image, which is not read; " + SAVE,
    "a.jxr": "is a JPEG XR image, which is not read; " + SAVE,
    "a.pdf": "is a PDF document, which is not read; " + SAVE,
    "a.psd": "is a Photoshop document, which is not read; " + SAVE,
    "a.mov": "is a video where a photo is meant; give the video alone, or save a picture of it.",
    "a.avi": "is a video where a photo is meant; give the video alone, or save a picture of it.",
    "a.mkv": "is a video where a photo is meant; give the video alone, or save a picture of it.",
    "empty.jpg": "is empty; copy it again.",
    "a.tga": "is not a PNG, JPEG or WebP image, nor TIFF, HEIC, AVIF, camera raw, OpenEXR or Radiance HDR; save it "
    "as one of these, or leave it out.",
}
BYTES = {
    "a.psd": b"8BPS\0\x01" + bytes(60),
    "a.jxr": b"II\xbc\x01" + bytes(60),
    "a.mov": b"\0\0\0\x18ftypqt  \0\0\0\0qt  " + bytes(40),
    "a.avi": b"RIFF\0\0\1\0AVI LIST" + bytes(60),
    "a.mkv": b"\x1a\x45\xdf\xa3" + bytes(60),
    "empty.jpg": b"",
    "a.jxl": lambda: imagecodecs.jpegxl_encode(PICTURE),
    "boxed.jxl": lambda: imagecodecs.jpegxl_encode(PICTURE, usecontainer=True),
}


@pytest.mark.parametrize("name", KINDS)
def test_what_is_not_read_is_one_sentence(tmp_path, name):
    if name in BYTES:
        content = BYTES[name]
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content())
    else:
        Image.fromarray(PICTURE).save(tmp_path / name)
    (tmp_path / name).rename(tmp_path / "IMG_1.jpg")  # content decides, not the name
    for read in (read_ldr, read_mask, image_size):
        with pytest.raises(InputError, match=re.escape(f"IMG_1.jpg {KINDS[name]}") + "$"):
            read(tmp_path / "IMG_1.jpg")


def test_folders_are_looked_through_for_names_that_cameras_give():
    assert {".jpg", ".jpe", ".jfif", ".mpo", ".heic", ".dng"} <= IMAGE_SUFFIXES

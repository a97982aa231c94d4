"""Whole photos, masks and maps: encoded samples of image files of any kind, linear float32 in memory; and PNG out."""

from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.core.files import atomic_path, write_bytes
from lightprobe.imaging import png16
from lightprobe.imaging.color import srgb_encode
from lightprobe.imaging.decoding import read_header
from lightprobe.imaging.exif import turned_size
from lightprobe.imaging.photo_file import PhotoFile


def image_size(path: Path, *, orient: bool = True) -> tuple[int, int]:
    """Return (width, height) from the header; `orient` as in `read_ldr`."""
    header = read_header(Path(path))
    return turned_size(header.size, header.orientation or 1) if orient else header.size


def read_ldr(path: Path, *, srgb: bool = True, orient: bool = True) -> tuple[np.ndarray, np.ndarray | None]:
    """Read a photo or a map: PNG, JPEG, WebP, TIFF, HEIC, AVIF, camera raw, OpenEXR or Radiance HDR.

    Returns float32 rgb (H, W, 3), linear sRGB and straight (not premultiplied), and float32 alpha (H, W) or None; 1.0
    is the file's white, floats may be above. `srgb=False` is for maps stored linearly, such as roughness: samples are
    only scaled to [0, 1]. `orient=False` leaves the rows as stored instead of following the EXIF orientation. Raises
    `InputError` naming the file when it is missing, too large, damaged, of another kind, or needs a library of the
    extra `photos` that is not installed.
    """
    image = PhotoFile(path, srgb=srgb, turn=None if orient else 1)
    color = np.empty((image.height, image.width, 3), np.float32)
    alpha = np.empty((image.height, image.width), np.float32) if image.has_alpha else None
    for first, last in image.strips():
        color[first:last], part = image.rows(first, last)
        if alpha is not None:
            alpha[first:last] = part
    return color, alpha


def read_alpha(path: Path, *, orient: bool = True) -> np.ndarray | None:
    """Return the alpha channel (H, W) float32 in [0, 1] of an image, or None when it has none."""
    image = PhotoFile(path, turn=None if orient else 1)
    parts = [image.rows(*strip)[1] for strip in image.strips()]
    return np.concatenate([part for part in parts if part is not None]) if image.has_alpha else None


def read_mask(path: Path, *, orient: bool = True) -> np.ndarray:
    """Read a mask as coverage: (H, W) float32 in [0, 1], no sRGB decoding.

    An alpha channel that is not opaque everywhere is the mask; otherwise the largest colour channel is.
    """
    image = PhotoFile(path, turn=None if orient else 1)
    return np.concatenate([image.mask_rows(*strip) for strip in image.strips()])


def write_png(
    path: Path, color: np.ndarray, alpha: np.ndarray | None = None, *, srgb: bool = True, bits: int = 8
) -> None:
    """Write linear straight `color` (H, W, 3) and optional `alpha` (H, W) as PNG, atomically.

    Values are clipped to [0, 1] and NaN becomes 0; `srgb=False` stores them without the sRGB curve; `bits` is 8 or 16.
    """
    encoded = srgb_encode(np.clip(np.nan_to_num(color), 0, 1)) if srgb else color
    planes = encoded if alpha is None else np.concatenate([encoded, np.asarray(alpha)[..., None]], axis=2)
    levels = 255 if bits == 8 else 65535
    samples = np.clip(np.nan_to_num(planes) * levels + 0.5, 0, levels).astype(np.uint8 if bits == 8 else np.uint16)
    if bits == 16:
        write_bytes(Path(path), png16.encode(samples))
        return
    with atomic_path(Path(path)) as temporary:
        Image.fromarray(np.ascontiguousarray(samples)).save(temporary, format="PNG")

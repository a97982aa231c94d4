"""Photos, masks and 8/16-bit PNG: encoded samples in files, linear float32 in memory.

Embedded colour profiles are not applied: samples are taken as sRGB, as the methods compared with do.
"""

import functools
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.core.files import atomic_path, write_bytes
from lightprobe.imaging import png16
from lightprobe.imaging.color import srgb_decode, srgb_encode
from lightprobe.imaging.exif import read_orientation, upright
from lightprobe.imaging.opening import decode_errors, open_image

_MODES = {"1": "L", "L": "L", "LA": "LA", "RGB": "RGB", "RGBA": "RGBA"}


def image_size(path: Path, *, orient: bool = True) -> tuple[int, int]:
    """Return (width, height) from the header; `orient` as in `read_ldr`."""
    path = Path(path)
    with open_image(path) as image:
        width, height = image.size
    return (height, width) if orient and read_orientation(path) >= 5 else (width, height)


def read_ldr(path: Path, *, srgb: bool = True, orient: bool = True) -> tuple[np.ndarray, np.ndarray | None]:
    """Read a PNG, JPEG or WebP of 8 or 16 bits.

    Returns float32 rgb (H, W, 3), linear and straight (not premultiplied), and float32 alpha (H, W) or None.
    `srgb=False` is for maps stored linearly, such as roughness: samples are only scaled to [0, 1]. `orient=False`
    leaves the rows as stored instead of following the EXIF orientation. Raises `InputError` naming the file when it is
    missing, too large, damaged or of another kind.
    """
    samples, alpha = _split(_samples(Path(path), orient))
    color = np.take(_table(samples.dtype.str, srgb), samples)
    return (np.repeat(color, 3, axis=2) if color.shape[2] == 1 else color), alpha


def read_alpha(path: Path, *, orient: bool = True) -> np.ndarray | None:
    """Return the alpha channel (H, W) float32 in [0, 1] of an image, or None when it has none."""
    return _split(_samples(Path(path), orient))[1]


def read_mask(path: Path, *, orient: bool = True) -> np.ndarray:
    """Read a mask as coverage: (H, W) float32 in [0, 1], no sRGB decoding.

    An alpha channel that is not opaque everywhere is the mask; otherwise the largest colour channel is.
    """
    samples, alpha = _split(_samples(Path(path), orient))
    if alpha is not None and alpha.min() < 1:
        return alpha
    return np.take(_table(samples.dtype.str, False), samples.max(axis=2))


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


def _samples(path: Path, orient: bool) -> np.ndarray:
    """Return the file's samples, (H, W, 1 | 2 | 3 | 4) uint8 or uint16."""
    with open_image(path) as image, decode_errors(path):
        if image.format == "PNG" and png16.is_sixteen_bit(path):
            pixels = png16.decode(path)
        else:
            transparent = "transparency" in image.info or image.mode in ("LA", "PA", "La", "RGBa")
            mode = "RGBA" if transparent and image.mode != "LA" else _MODES.get(image.mode, "RGB")
            pixels = np.asarray(image if image.mode == mode else image.convert(mode))
    pixels = pixels.reshape(*pixels.shape[:2], -1)
    orientation = read_orientation(path) if orient else 1
    return upright(pixels, orientation) if orientation != 1 else pixels


def _split(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Split samples into colour (H, W, 1 | 3) as stored and alpha (H, W) float32 in [0, 1] or None."""
    channels = samples.shape[2]
    if channels in (1, 3):
        return samples, None
    return samples[..., : channels - 1], np.take(_table(samples.dtype.str, False), samples[..., -1])


@functools.cache
def _table(dtype: str, srgb: bool) -> np.ndarray:
    """Return the float32 value of every integer sample; a look-up is exact and faster than the power curve."""
    levels = np.iinfo(np.dtype(dtype)).max
    values = np.arange(levels + 1) / levels
    return (srgb_decode(values) if srgb else values).astype(np.float32)

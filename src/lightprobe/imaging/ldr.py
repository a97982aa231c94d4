"""Whole photos, masks and maps: image files of any kind in, linear float32 in memory, PNG out."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.core.files import atomic_path, write_bytes
from lightprobe.imaging import png16
from lightprobe.imaging.color import srgb_encode
from lightprobe.imaging.decoding import read_header
from lightprobe.imaging.exif import turned_size
from lightprobe.imaging.photo_file import PhotoFile
from lightprobe.imaging.resize import STRIP, resize_rows
from lightprobe.imaging.tags import upright_exif


def image_size(path: Path, *, orient: bool = True) -> tuple[int, int]:
    """Return (width, height) from the header; `orient` as in `read_ldr`."""
    header = read_header(Path(path))
    return turned_size(header.size, header.orientation or 1) if orient else header.size


def read_ldr(
    path: Path, *, srgb: bool = True, orient: bool = True, size: tuple[int, int] | None = None
) -> tuple[np.ndarray, np.ndarray | None]:
    """Read a photo or a map: PNG, JPEG, WebP, TIFF, HEIC, AVIF, camera raw, OpenEXR or Radiance HDR.

    Returns float32 rgb (H, W, 3), linear sRGB and straight (not premultiplied), and float32 alpha (H, W) or
    None; 1.0 is the file's white, floats may be above. `srgb=False` is for maps stored linearly, such as
    roughness: samples are only scaled to [0, 1]. `orient=False` leaves the rows as stored instead of
    following the EXIF orientation. `size` (height, width): what it is area-averaged to, colour and alpha each
    for itself, without being held whole. Raises `InputError` naming the file when it is missing, too large,
    damaged, of another kind, or needs a library of the extra `photos` that is not installed.
    """
    return _colors(PhotoFile(path, srgb=srgb, turn=None if orient else 1), size)


def read_photo(
    path: Path, *, size: tuple[int, int] | None = None
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
    """Return colour and alpha as `read_ldr`, and where the file's white hides how bright it was, (H, W, 3) bool.

    That is told of what the file stores, before its primaries are converted. Of reduced photos a pixel with
    any source pixel at white counts.
    """
    image = PhotoFile(path)
    return *_colors(image, size), _gathered(image, image.clipped_rows, size, 3) > 0


def _colors(image: PhotoFile, size: tuple[int, int] | None) -> tuple[np.ndarray, np.ndarray | None]:
    """Return colour (H, W, 3) and alpha (H, W) or None of a file, as `read_ldr`."""
    color = _gathered(image, lambda *rows: image.rows(*rows)[0], size, 3)
    return color, _gathered(image, image.alpha_rows, size) if image.has_alpha else None


def read_alpha(path: Path, *, orient: bool = True, size: tuple[int, int] | None = None) -> np.ndarray | None:
    """Return the alpha channel (H, W) float32 in [0, 1] of an image, or None; `size` as in `read_ldr`."""
    image = PhotoFile(path, turn=None if orient else 1)
    return _gathered(image, image.alpha_rows, size) if image.has_alpha else None


def alpha_range(path: Path) -> tuple[float, float]:
    """Return the lowest and the highest alpha in [0, 1] of an image, (1, 1) of one without an alpha channel."""
    image = PhotoFile(path, turn=1)
    if not image.has_alpha:
        return 1.0, 1.0
    ranges = [
        (float(alpha.min()), float(alpha.max())) for alpha in (image.alpha_rows(*s) for s in image.strips())
    ]
    return min(low for low, _ in ranges), max(high for _, high in ranges)


def read_mask(path: Path, *, turn: int | None = None, size: tuple[int, int] | None = None) -> np.ndarray:
    """Read a mask as coverage: (H, W) float32 in [0, 1], no sRGB decoding.

    An alpha channel that is not opaque everywhere is the mask; otherwise the largest colour channel is. turn:
    EXIF orientation 1..8 it is turned by, by default its own. `size` as in `read_ldr`.
    """
    image = PhotoFile(path, turn=turn)
    return _gathered(image, image.mask_rows, size)


def _gathered(
    image: PhotoFile, rows: Callable[[int, int], np.ndarray], size: tuple[int, int] | None, *channels: int
) -> np.ndarray:
    """Return all rows (H, W, *channels) of what `rows` returns strips of, area-averaged to `size` if given."""
    shape = (image.height, image.width, *channels)
    if size is not None and size != shape[:2]:
        return resize_rows(rows, shape, *size)
    whole = np.empty(shape, rows(0, 1).dtype)
    for first, last in image.strips():
        whole[first:last] = rows(first, last)
    return whole


def write_png(
    path: Path, color: np.ndarray, alpha: np.ndarray | None = None, *, srgb: bool = True, bits: int = 8
) -> None:
    """Write linear straight `color` (H, W, 3) and optional `alpha` (H, W) as PNG, atomically.

    Values are clipped to [0, 1] and NaN becomes 0; `srgb=False` stores them without the sRGB curve; `bits` is
    8 or 16.
    """
    height, width = color.shape[:2]
    levels, channels = (255 if bits == 8 else 65535), 3 if alpha is None else 4
    samples = np.empty((height, width, channels), np.uint8 if bits == 8 else np.uint16)
    step = max(1, STRIP // max(width, 1))
    for top in range(0, height, step):  # in strips: the floats on the way take many times what is written
        rows = color[top : top + step]
        rows = srgb_encode(np.clip(np.nan_to_num(rows), 0, 1)) if srgb else rows
        if alpha is not None:
            rows = np.concatenate([rows, np.asarray(alpha)[top : top + step, :, None]], axis=2)
        samples[top : top + step] = np.clip(np.nan_to_num(rows) * levels + 0.5, 0, levels)
    _write_encoded(Path(path), samples)


def write_mask(path: Path, mask: np.ndarray, size: tuple[int, int] | None = None) -> None:
    """Write coverage (H, W) in [0, 1] as PNG, white object on black, atomically.

    size: (height, width) that it is enlarged to, bilinearly. The file says that it is upright: a mask that
    does not is turned along with its photo.
    """
    grey = np.empty(mask.shape, np.uint8)
    step = max(1, STRIP // max(mask.shape[1], 1))
    for top in range(0, len(mask), step):
        grey[top : top + step] = np.clip(np.nan_to_num(mask[top : top + step]) * 255 + 0.5, 0, 255)
    picture = Image.fromarray(grey)
    if size is not None and size != mask.shape:
        picture = picture.resize((size[1], size[0]), Image.Resampling.BILINEAR)
    with atomic_path(Path(path)) as temporary:
        picture.save(temporary, format="PNG", exif=upright_exif())


def _write_encoded(path: Path, samples: np.ndarray) -> None:
    """Write samples (H, W, 3 | 4) uint8 or uint16, as they stand in the file, as PNG, atomically."""
    if samples.dtype == np.uint16:
        write_bytes(path, png16.encode(samples))
        return
    with atomic_path(path) as temporary:
        Image.fromarray(samples).save(temporary, format="PNG")

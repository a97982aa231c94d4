"""Photos, masks and 8/16-bit PNG: encoded samples in files, linear float32 in memory.

Embedded colour profiles are not applied: samples are taken as sRGB, as the methods compared with do.
"""

import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.core.files import atomic_path, write_bytes
from lightprobe.imaging import png16
from lightprobe.imaging.color import srgb_decode, srgb_encode
from lightprobe.imaging.exif import read_orientation, turned_size, upright
from lightprobe.imaging.opening import decode_errors, open_image
from lightprobe.imaging.resize import STRIP

_MODES = {"1": "L", "L": "L", "LA": "LA", "RGB": "RGB", "RGBA": "RGBA"}


# Pillow's name of what EXIF orientations 2 to 8 ask for
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT, 3: Image.Transpose.ROTATE_180, 4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE, 6: Image.Transpose.ROTATE_270, 7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}  # fmt: skip


def image_size(path: Path, *, orient: bool = True) -> tuple[int, int]:
    """Return (width, height) from the header; `orient` as in `read_ldr`."""
    path = Path(path)
    with open_image(path) as image:
        size = image.size
    return turned_size(size, read_orientation(path) or 1) if orient else size


class LdrImage:
    """The samples of a PNG, JPEG or WebP of 8 or 16 bits: decoded once, and made into floats a few rows at a time.

    Of a large photo the floats take four times the memory of its samples, and what is computed from them many times.
    """

    def __init__(self, path: Path, *, srgb: bool = True, turn: int | None = None):
        """Decode a file, errors and `srgb` as in `read_ldr`.

        turn: EXIF orientation 1..8 the samples are turned by; None: the file's own.
        """
        path = Path(path)
        self._samples = _decoded(path, (read_orientation(path) or 1) if turn is None else turn)
        self._srgb = srgb
        first = self._stored(0, 1)
        self.height, self.width = _height(self._samples), first.shape[1]
        self._table, self._linear = _table(first.dtype.str, srgb), _table(first.dtype.str, False)
        self.has_alpha = first.shape[2] in (2, 4)

    def rows(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Return float32 rgb (h, W, 3) and alpha (h, W) or None of the rows first..last - 1, as `read_ldr`."""
        colors, alpha = self._split(first, last)
        rgb = np.take(self._table, colors)
        return (np.repeat(rgb, 3, axis=2) if rgb.shape[2] == 1 else rgb), alpha

    def mask_rows(self, first: int, last: int) -> np.ndarray:
        """Return float32 coverage (h, W) of the rows first..last - 1, as `read_mask`."""
        colors, alpha = self._split(first, last)
        if alpha is not None and self._is_cutout:
            return alpha
        return np.take(self._linear, colors.max(axis=2))

    def strips(self) -> Iterator[tuple[int, int]]:
        """Yield (first, last) of consecutive strips of rows that are worked on at once."""
        step = max(1, STRIP // self.width)
        for first in range(0, self.height, step):
            yield first, min(first + step, self.height)

    @functools.cached_property
    def _is_cutout(self) -> bool:
        """Whether the alpha channel is not opaque everywhere."""
        parts = (self._split(*strip)[1] for strip in self.strips())
        return any(alpha is not None and alpha.min() < 1 for alpha in parts)

    def _split(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Return colour (h, W, 1 | 3) as stored and alpha (h, W) float32 in [0, 1] or None."""
        stored = self._stored(first, last)
        if not self.has_alpha:
            return stored, None
        return stored[..., :-1], np.take(self._linear, stored[..., -1])

    def _stored(self, first: int, last: int) -> np.ndarray:
        """Return samples (h, W, 1 | 2 | 3 | 4) uint8 or uint16."""
        if isinstance(self._samples, np.ndarray):
            return self._samples[first:last]
        part = np.asarray(self._samples.crop((0, first, self._samples.width, last)))
        return part.reshape(*part.shape[:2], -1)


def read_ldr(path: Path, *, srgb: bool = True, orient: bool = True) -> tuple[np.ndarray, np.ndarray | None]:
    """Read a PNG, JPEG or WebP of 8 or 16 bits.

    Returns float32 rgb (H, W, 3), linear and straight (not premultiplied), and float32 alpha (H, W) or None.
    `srgb=False` is for maps stored linearly, such as roughness: samples are only scaled to [0, 1]. `orient=False`
    leaves the rows as stored instead of following the EXIF orientation. Raises `InputError` naming the file when it is
    missing, too large, damaged or of another kind.
    """
    image = LdrImage(path, srgb=srgb, turn=None if orient else 1)
    color = np.empty((image.height, image.width, 3), np.float32)
    alpha = np.empty((image.height, image.width), np.float32) if image.has_alpha else None
    for first, last in image.strips():
        color[first:last], part = image.rows(first, last)
        if alpha is not None:
            alpha[first:last] = part
    return color, alpha


def read_alpha(path: Path, *, orient: bool = True) -> np.ndarray | None:
    """Return the alpha channel (H, W) float32 in [0, 1] of an image, or None when it has none."""
    image = LdrImage(path, turn=None if orient else 1)
    parts = [image.rows(*strip)[1] for strip in image.strips()]
    return np.concatenate([part for part in parts if part is not None]) if image.has_alpha else None


def read_mask(path: Path, *, orient: bool = True) -> np.ndarray:
    """Read a mask as coverage: (H, W) float32 in [0, 1], no sRGB decoding.

    An alpha channel that is not opaque everywhere is the mask; otherwise the largest colour channel is.
    """
    image = LdrImage(path, turn=None if orient else 1)
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


def _decoded(path: Path, turn: int) -> Image.Image | np.ndarray:
    """Return a file's samples turned by an EXIF orientation 1..8.

    A decoded Pillow image of 8 bits, or (H, W, 1 | 2 | 3 | 4) uint16.
    """
    with open_image(path) as image, decode_errors(path):
        if image.format == "PNG" and png16.is_sixteen_bit(path):
            return upright(png16.decode(path), turn)
        transparent = "transparency" in image.info or image.mode in ("LA", "PA", "La", "RGBa")
        mode = "RGBA" if transparent and image.mode != "LA" else _MODES.get(image.mode, "RGB")
        image.load()
        samples = image if image.mode == mode else image.convert(mode)
    return samples.transpose(_TURNS[turn]) if turn in _TURNS else samples


def _height(samples: Image.Image | np.ndarray) -> int:
    return samples.shape[0] if isinstance(samples, np.ndarray) else samples.height


@functools.cache
def _table(dtype: str, srgb: bool) -> np.ndarray:
    """Return the float32 value of every integer sample; a look-up is exact and faster than the power curve."""
    levels = np.iinfo(np.dtype(dtype)).max
    values = np.arange(levels + 1) / levels
    return (srgb_decode(values) if srgb else values).astype(np.float32)

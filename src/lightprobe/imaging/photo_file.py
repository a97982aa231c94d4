"""An image file of any kind: decoded once, and made into linear floats a few rows at a time.

Colours become linear sRGB in which 1.0 is the file's white. Files of floats (OpenEXR, Radiance, TIFF) are
linear already and have no white to clip at.
"""

import functools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.imaging.decoding import decode
from lightprobe.imaging.encodings import LINEAR, Curve, Encoding, linear
from lightprobe.imaging.exif import read_orientation, upright
from lightprobe.imaging.gain_map import GainMap
from lightprobe.imaging.resize import STRIP

CLIPPED = 0.98  # linear value from which a photo is saturated; half a code below 255 of 8 bits is .989
_BRIGHTEST = 1e9  # of floats, which may be infinite: sums over a photo stay numbers

# Pillow's name of what EXIF orientations 2 to 8 ask for
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}


class PhotoFile:
    """The samples of an image file, decoded once, and made into floats a few rows at a time.

    Of a large photo the floats take four times the memory of its samples, and what is computed from them many
    times.
    """

    def __init__(self, path: Path, *, srgb: bool = True, turn: int | None = None):
        """Decode a file, errors and `srgb` as in `read_ldr`.

        turn: EXIF orientation 1..8 the samples are turned by; None: the file's own.
        """
        path = Path(path)
        turn = (read_orientation(path) or 1) if turn is None else turn
        found = decode(path)
        values = found.values
        if isinstance(values, np.ndarray):
            self._samples: Image.Image | np.ndarray = upright(values, turn) if turn != 1 else values
        else:
            self._samples = values.transpose(_TURNS[turn]) if turn in _TURNS else values
        self._levels, self._encoding = found.levels, found.encoding if srgb else LINEAR
        self._gain_map = _turned(found.gain_map, turn) if srgb and found.gain_map is not None else None
        first = self._stored(0, 1)
        self.height = _height(self._samples)
        self.width = first.shape[1]
        self.has_alpha = first.shape[2] in (2, 4)
        self.has_white = first.dtype.kind == "u"

    def rows(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Return float32 rgb (h, W, 3) and alpha (h, W) or None of the rows first..last - 1, as `read_ldr`."""
        colors, alpha = self._split(first, last)
        if self._gain_map is None:
            return linear_srgb(colors, self._levels, self._encoding), alpha
        base, to_srgb = _light(colors, self._levels, self._encoding), self._encoding.matrix
        if self._gain_map.matrix is not None:
            base = _in_primaries(base, np.linalg.solve(self._gain_map.matrix, _or_identity(to_srgb)))
            to_srgb = self._gain_map.matrix
        bright = self._gain_map.brighten(base, first, (self.height, self.width))
        return np.maximum(_in_primaries(bright, to_srgb), 0), alpha

    def alpha_rows(self, first: int, last: int) -> np.ndarray:
        """Return float32 alpha (h, W) of the rows first..last - 1 of a file that has some."""
        return self._plain(self._stored(first, last)[..., -1])

    def clipped_rows(self, first: int, last: int) -> np.ndarray:
        """Return where rows first..last - 1 reach the file's white, (h, W, 3) bool, per channel as stored.

        What the file's own primaries clip is told before they are converted, which would move it away from
        white.
        """
        colors, _ = self._split(first, last)
        if not self.has_white:
            return np.zeros((*colors.shape[:2], 3), bool)
        tables = [_table(self._levels, curve) for curve in self._encoding.curves]
        least = np.array([np.argmax(table >= CLIPPED * table[-1]) for table in tables])  # curves rise
        clipped = colors >= least
        if self._gain_map is not None:  # it says how bright white was, up to its own end
            clipped = clipped & self._gain_map.full_rows(first, last, (self.height, self.width))
        return np.repeat(clipped, 3, axis=2) if clipped.shape[2] == 1 else clipped

    def mask_rows(self, first: int, last: int) -> np.ndarray:
        """Return float32 coverage (h, W) of the rows first..last - 1, as `read_mask`."""
        colors, alpha = self._split(first, last)
        if alpha is not None and self._is_cutout:
            return alpha
        return self._plain(colors.max(axis=2))

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
        return stored[..., :-1], self._plain(stored[..., -1])

    def _stored(self, first: int, last: int) -> np.ndarray:
        """Return samples (h, W, 1 | 2 | 3 | 4) uint8, uint16 or float32 of these rows as they were decoded."""
        if isinstance(self._samples, np.ndarray):
            return self._samples[first:last]
        part = np.asarray(self._samples.crop((0, first, self._samples.width, last)))
        return part.reshape(*part.shape[:2], -1)

    def _plain(self, samples: np.ndarray) -> np.ndarray:
        """Return samples (h, W) without any curve as float32 in [0, 1]."""
        if not self.has_white:
            return np.clip(np.nan_to_num(samples), 0, 1).astype(np.float32, copy=False)
        return np.take(_table(self._levels, linear), samples)


def linear_srgb(colors: np.ndarray, levels: int, encoding: Encoding) -> np.ndarray:
    """Return float32 linear sRGB (h, W, 3) of colour samples (h, W, 1 | 3).

    Integers from 0 to `levels`, of which each has one value; floats are linear already.
    """
    rgb = _light(colors, levels, encoding)
    return rgb if encoding.matrix is None else np.maximum(_in_primaries(rgb, encoding.matrix), 0)


def _light(colors: np.ndarray, levels: int, encoding: Encoding) -> np.ndarray:
    """Return float32 linear light (h, W, 3) in the primaries of the file."""
    if colors.shape[2] == 1 and len(encoding.curves) == 3:  # grey, with the profile of a colour picture
        colors = np.repeat(colors, 3, axis=2)
    if colors.dtype.kind == "f":
        rgb = np.clip(np.nan_to_num(colors), 0, _BRIGHTEST).astype(np.float32, copy=False)
    elif len(encoding.curves) == 1:
        rgb = np.take(_table(levels, encoding.curves[0]), colors)
    else:
        tables = [_table(levels, curve) for curve in encoding.curves]
        rgb = np.stack([np.take(table, colors[..., k]) for k, table in enumerate(tables)], axis=2)
    return np.repeat(rgb, 3, axis=2) if rgb.shape[2] == 1 else rgb


def _in_primaries(rgb: np.ndarray, matrix: np.ndarray | None) -> np.ndarray:
    """Return colours (h, W, 3) in the primaries that `matrix` (3, 3) leads to."""
    return rgb if matrix is None else rgb @ matrix.T.astype(np.float32)


def _or_identity(matrix: np.ndarray | None) -> np.ndarray:
    return np.eye(3) if matrix is None else matrix


def _turned(gain_map: GainMap, turn: int) -> GainMap:
    """Return a gain map turned along with its picture by EXIF orientation 1..8."""
    return replace(gain_map, samples=upright(gain_map.samples, turn))


def _height(samples: Image.Image | np.ndarray) -> int:
    return samples.shape[0] if isinstance(samples, np.ndarray) else samples.height


@functools.lru_cache(maxsize=32)
def _table(levels: int, curve: Curve) -> np.ndarray:
    """Return the float32 value of every integer sample; a look-up is exact and faster than the power curve."""
    return np.asarray(curve(np.arange(levels + 1) / levels)).astype(np.float32)

"""Equirectangular maps at other sizes, with the mean of every texel kept.

Notation: f is the map (H, W), W = 2H; F is wanted k times as fine. F has to be smooth, positive, and average
back to f:

    F = exp(sum_j c_j B(u - j)),   mean of F over texel i = f_i

B is the biquadratic B-spline on the texels' grid, so F and its first derivatives are continuous. The
logarithm keeps a lamp of a thousand times its surroundings from ringing below zero, as a spline of f itself
does; its neighbours are darker on their far sides, as some of it reaches into them and their means stay. The
c are found by the fixed point c <- c + ln(f / mean of F), which starts at ln f: the means answer to c with
positive weights that sum to 1, so that errors shrink. Columns wrap; a row beyond a pole is the row on this
side, half a turn away.

These means are over the texel's area of the picture: within a texel solid angle hardly changes but beside the
poles. A coarser map takes means by solid angle, as a lamp at the zenith lies in the narrowest of rows.
"""

import re

import numpy as np

from lightprobe.core.errors import ConfigError
from lightprobe.imaging import resize_area
from lightprobe.light.equirect import solid_angles

HEIGHTS = (64, 128, 256, 512, 1024, 2048)  # rows of the maps that may be asked for
_SIZE = re.compile(r"(\d{1,5})(?:x(\d{1,5}))?")
_ITERATIONS, _CLOSE = 60, 1e-3  # of the fixed point, and the largest relative error at which it may stop
_MIDPOINTS = 8  # samples along a texel that are summed one by one; with more, Gauss' rule does as well
_GAUSS = 4  # points of that rule
_BLACK = 1e-6  # of a channel's mean: darker texels are interpolated as this bright, and scaled at the end
_AT_ONCE = 2**18  # texels of the wanted map that are computed at once


def map_height(size: str) -> int:
    """Return the rows of a map of `size`, such as "2048x1024" or its width "2048".

    Raises `ConfigError` unless the height is 64 to 2048 by powers of two and the width twice that.
    """
    found = _SIZE.fullmatch(size.strip().lower())
    width = int(found[1]) if found else 0
    height = int(found[2]) if found and found[2] else width // 2
    if width != 2 * height or height not in HEIGHTS:
        sizes = ", ".join(f"{2 * rows}x{rows}" for rows in HEIGHTS)
        words = f"A map cannot have the --size '{size[:40]}'"
        raise ConfigError(f"{words}; give one of {sizes}, or only its width.")
    return height


def resized_map(image: np.ndarray, height: int) -> np.ndarray:
    """Return a map (H, 2H, C) >= 0 with `height` rows, (height, 2 height, C) float32 >= 0.

    Coarser: means by solid angle. Finer: smooth, and averages back to the map; a map whose rows do not divide
    `height` goes through the next finer one that do, by areas.
    """
    rows = image.shape[0]
    if height <= rows:
        return image.astype(np.float32) if height == rows else reduced_map(image, height)
    factor = height // rows
    if rows * factor != height:
        between = height
        while between % 2 == 0 and between // 2 >= rows:
            between //= 2
        return resized_map(resize_area(image, between, 2 * between), height)
    return _magnified(image, factor)


def reduced_map(image: np.ndarray, height: int) -> np.ndarray:
    """Return the means by solid angle of a map (H, 2H, C) over fewer rows, (height, 2 height, C)."""
    weight = solid_angles(image.shape[0])[:, :1, None].numpy()  # of a row's texels
    return resize_area(image * weight, height, 2 * height) / resize_area(weight, height, 1)


def _magnified(image: np.ndarray, factor: int) -> np.ndarray:
    """Return the smooth map (k H, k W, C) float32 of `image` (H, W, C), k the factor, a few rows at a time."""
    rows, columns, channels = image.shape
    coefficients = _coefficients(np.asarray(image, np.float64), factor)
    result = np.empty((rows * factor, columns * factor, channels), np.float32)
    step = max(1, _AT_ONCE // (columns * factor**2))
    weights = _spline(_midpoints(factor))
    for top in range(0, rows, step):
        given = image[top : top + step]
        padded = coefficients[top : top + step + 2]
        fine = np.exp(_interpolated(padded, weights))  # (h, k, W, k, C)
        fine *= (given / np.maximum(fine.mean((1, 3)), np.finfo(np.float32).tiny))[:, None, :, None]
        result[top * factor : (top + len(given)) * factor] = fine.reshape(-1, columns * factor, channels)
    return result


def _coefficients(image: np.ndarray, factor: int) -> np.ndarray:
    """Return padded coefficients (H + 2, W + 2, C) of the spline whose texels have the map's means."""
    floor = np.maximum(_BLACK * image.mean((0, 1)), np.finfo(np.float32).tiny)
    wanted = np.maximum(image, floor)
    if factor <= _MIDPOINTS:
        points, shares = _midpoints(factor), np.full(factor, 1 / factor)
    else:
        nodes, gauss = np.polynomial.legendre.leggauss(_GAUSS)
        points, shares = nodes / 2, gauss / 2
    weights = _spline(points)
    values = np.log(wanted)
    for _ in range(_ITERATIONS):
        fine = np.exp(_interpolated(_padded(values), weights))
        ratio = wanted / np.einsum("hiwjc,i,j->hwc", fine, shares, shares)
        values += np.log(ratio)
        if np.abs(ratio - 1).max() < _CLOSE:
            break
    return _padded(values)


def _interpolated(padded: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the spline (h, n, W, n, C) of `padded` (h + 2, W + 2, C) at n points along a texel's edges."""
    rows, columns = padded.shape[0] - 2, padded.shape[1] - 2
    down = sum(weights[None, :, tap, None, None] * padded[tap : tap + rows, None] for tap in range(3))
    return sum(weights[:, tap, None] * down[:, :, tap : tap + columns, None] for tap in range(3))


def _padded(values: np.ndarray) -> np.ndarray:
    """Return (H, W, C) with a border of one texel: beyond the poles, and around the seam."""
    half = values.shape[1] // 2
    whole = np.concatenate([np.roll(values[:1], half, 1), values, np.roll(values[-1:], half, 1)])
    return np.concatenate([whole[:, -1:], whole, whole[:, :1]], 1)


def _midpoints(count: int) -> np.ndarray:
    """Return the middles of `count` equal parts of a texel, from -1/2 to 1/2."""
    return (np.arange(count) + 0.5) / count - 0.5


def _spline(points: np.ndarray) -> np.ndarray:
    """Return the weights (n, 3) of the texel before, at and after `points` (n,) in [-1/2, 1/2]."""
    return np.stack([0.5 * (0.5 - points) ** 2, 0.75 - points**2, 0.5 * (0.5 + points) ** 2], 1)

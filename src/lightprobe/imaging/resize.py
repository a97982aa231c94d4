"""Area resampling: every output pixel is the mean of the input area it covers."""

from collections.abc import Callable

import numpy as np
from scipy import sparse

STRIP = 2**19  # pixels of an image that are worked on at once


def resize_area(array: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return `array` (H, W) or (H, W, C), any float dtype, area-averaged to `height` x `width` as float32.

    Exact for any ratio: pixels cut by an output edge count by their fraction. Means are preserved, so average
    linear light, and colour with alpha premultiplied.
    """
    return resize_rows(lambda first, last: array[first:last], array.shape, height, width)


def resize_rows(
    read: Callable[[int, int], np.ndarray], shape: tuple[int, ...], height: int, width: int
) -> np.ndarray:
    """Return `resize_area` of an image (H, W) or (H, W, C) = `shape` that is never held as a whole.

    `read(first, last)` returns the image's rows first..last - 1. The result has the same bits, as the rows
    that an output row averages are always summed from the top.
    """
    rows, columns = shape[:2]
    down, across = _overlap(rows, height), _overlap(columns, width)
    result = np.empty((height, width, *shape[2:]), np.float32)
    at_once = max(1, round(STRIP / columns * height / rows))
    for top in range(0, height, at_once):
        part = down[top : top + at_once]
        first, last = int(part.indices.min()), int(part.indices.max()) + 1
        strip = np.asarray(read(first, last), np.float32).reshape(last - first, -1)
        flat = part[:, first:last] @ strip
        count = flat.shape[0]
        turned = np.swapaxes(flat.reshape(count, columns, -1), 0, 1).reshape(columns, -1)
        turned = (across @ turned).reshape(width, count, -1)
        result[top : top + count] = np.swapaxes(turned, 0, 1).reshape(count, width, *shape[2:])
    return result


def shrink_area(array: np.ndarray, side: int) -> np.ndarray:
    """Return `array` (H, W) or (H, W, C) as `resize_area` does, its longer side at most `side` pixels."""
    scale = min(1.0, side / max(array.shape[:2]))
    height, width = (max(1, round(length * scale)) for length in array.shape[:2])
    return resize_area(array, height, width)


def bilinear_grid(samples: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return `samples` (h, w, C) between its own, (n, m, C) float32, where `rows` (n,) cross `columns` (m,).

    Both count in samples, 0 the first one's middle; beyond the outermost they are held.
    """
    (above, below, down), (left, right, across) = (
        _neighbours(places, length) for places, length in zip((rows, columns), samples.shape, strict=False)
    )
    strips = samples[above] * (1 - down[:, None, None]) + samples[below] * down[:, None, None]
    beside = (
        np.take(strips, columns, axis=1) for columns in (left, right)
    )  # several times as fast as [:, left]
    return next(beside) * (1 - across[:, None]) + next(beside) * across[:, None]


def _neighbours(places: np.ndarray, length: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the two of `length` samples around each of `places`, and the weight of the second, float32."""
    at = np.clip(places, 0, length - 1)
    low = np.floor(at).astype(np.intp)
    return low, np.minimum(low + 1, length - 1), (at - low).astype(np.float32)


def _overlap(source: int, target: int) -> sparse.csr_array:
    """Return (target, source) float32 weights: the share of each output cell that each input cell fills."""
    edges = np.linspace(0, source, target + 1)
    first = np.minimum(np.floor(edges[:-1]).astype(np.int64), source - 1)
    last = np.maximum(np.ceil(edges[1:] - 1e-9).astype(np.int64), first + 1)
    counts = last - first
    cell = np.repeat(np.arange(target), counts)
    column = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + first[cell]
    share = np.minimum(column + 1, edges[cell + 1]) - np.maximum(column, edges[cell])
    weights = (share / (edges[cell + 1] - edges[cell])).astype(np.float32)
    return sparse.csr_array((weights, (cell, column)), shape=(target, source))

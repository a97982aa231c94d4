"""Area resampling: every output pixel is the mean of the input area it covers."""

import numpy as np
from scipy import sparse


def resize_area(array: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return `array` (H, W) or (H, W, C), any float dtype, area-averaged to `height` x `width` as float32.

    Exact for any ratio: pixels cut by an output edge count by their fraction. Means are preserved, so average linear
    light, and colour with alpha premultiplied.
    """
    rows, columns = array.shape[:2]
    flat = _overlap(rows, height) @ np.asarray(array, np.float32).reshape(rows, -1)
    turned = np.swapaxes(flat.reshape(height, columns, -1), 0, 1).reshape(columns, -1)
    turned = (_overlap(columns, width) @ turned).reshape(width, height, -1)
    return np.ascontiguousarray(np.swapaxes(turned, 0, 1)).reshape(height, width, *array.shape[2:])


def shrink_area(array: np.ndarray, side: int) -> np.ndarray:
    """Return `array` (H, W) or (H, W, C) as `resize_area` does, its longer side at most `side` pixels."""
    scale = min(1.0, side / max(array.shape[:2]))
    height, width = (max(1, round(length * scale)) for length in array.shape[:2])
    return resize_area(array, height, width)


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

"""Plain body of the lobes' rows; symbols as in `lightprobe.kernels.lobe_rows`. The lobe must have a width."""

import itertools
import math

import numpy as np

from lightprobe.kernels.lobe_rows import ROOT


def refine(
    directions: np.ndarray, frames: np.ndarray, alpha: float, total: float, resolution: int, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return start (N + 1,), node (entries,) and weight (entries,)."""
    rows = [_row(direction, frames, alpha, total, resolution, tolerance) for direction in directions]
    start = np.concatenate([[0], np.cumsum([len(row) for row in rows], dtype=np.int64)])
    nodes = np.array([node for row in rows for node in row], np.int32)
    return start, nodes, np.array([weight for row in rows for weight in row.values()], np.float64)


def _row(
    direction: np.ndarray, frames: np.ndarray, alpha: float, total: float, resolution: int, tolerance: float
) -> dict[int, float]:
    weights: dict[int, float] = {}
    squares = [(ROOT, *place) for place in itertools.product(range(6), range(ROOT), range(ROOT))]
    while squares:
        size, face, y, x = squares.pop()
        chord, area = _seen(frames[face], direction, (2 * x + 1) / size - 1, (2 * y + 1) / size - 1, size)
        extent = math.sqrt(area)
        near = max(chord - 0.75 * extent, 0.0)
        share = min(area * _lobe(near, alpha) / total, 1.0)
        if share * extent > tolerance * math.sqrt(4 * alpha**2 + near**2):
            squares += [(2 * size, face, 2 * y + down, 2 * x + along) for down in (0, 1) for along in (0, 1)]
        elif share > 0:
            level = min(size, resolution)
            first = sum(6 * (1 << k) ** 2 for k in range(1, level.bit_length() - 1))
            node = first + (face * level + y * level // size) * level + x * level // size
            weights[node] = weights.get(node, 0.0) + _integral(frames[face], direction, x, y, size, alpha)
    return weights


def _integral(frame: np.ndarray, direction: np.ndarray, x: int, y: int, size: int, alpha: float) -> float:
    """Return the integral of the lobe over a square, by 2 x 2 Gauss points."""
    offsets = (1 - 1 / math.sqrt(3), 1 + 1 / math.sqrt(3))
    points = [
        ((2 * x + along) / size - 1, (2 * y + down) / size - 1) for along in offsets for down in offsets
    ]
    seen = [_seen(frame, direction, *point, 2 * size) for point in points]
    return sum(area * _lobe(chord, alpha) for chord, area in seen)


def _seen(frame: np.ndarray, direction: np.ndarray, a: float, b: float, size: int) -> tuple[float, float]:
    """Return the chord from `direction` to the face point (a, b), and the solid angle of a small square
    around it.
    """
    length = math.sqrt(1 + a * a + b * b)
    chord = np.linalg.norm(np.array([1.0, a, b]) @ frame / length - direction)
    return float(chord), 4 / (size**2 * length**3)


def _lobe(chord: float, alpha: float) -> float:
    return max(1 - chord**2 / 2, 0.0) / (alpha**2 + (1 - alpha**2) * chord**2 / 4) ** 2

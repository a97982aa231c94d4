"""Numba loops of the lobes' rows; symbols as in `lightprobe.kernels.lobe_rows`. Rows are counted, then written."""

import math

import numpy as np
from numba import prange

from lightprobe.core.jit import compiled
from lightprobe.kernels.lobe_rows import ROOT

GAUSS = 1.0 / math.sqrt(3.0)
DEEPEST = 160  # squares that wait to be looked at; a lobe without width would go down for ever


@compiled()
def _lobe(chord2, alpha):
    quarter = 0.25 * chord2
    denominator = alpha * alpha + (1.0 - alpha * alpha) * quarter
    return max(1.0 - 2.0 * quarter, 0.0) / (denominator * denominator)


@compiled()
def _pyramid_offset(size):
    """Return the number of squares in the pyramid's levels above the one with `size` squares along an edge."""
    return 2 * (size * size - ROOT * ROOT)


@compiled()
def _chord2(frame, direction, a, b):
    """Return the squared chord from `direction` to the face point (a, b), and the point's distance from 0."""
    length = math.sqrt(1.0 + a * a + b * b)
    chord2 = 0.0
    for axis in range(3):
        step = (frame[0, axis] + a * frame[1, axis] + b * frame[2, axis]) / length - direction[axis]
        chord2 += step * step
    return chord2, length


@compiled()
def _square_weight(frame, direction, x, y, size, alpha):
    """Return the integral of the lobe over a square by 2 x 2 Gauss points on the face plane."""
    weight = 0.0
    for corner in range(4):
        a = (2.0 * x + 1.0 + (GAUSS if corner & 1 else -GAUSS)) / size - 1.0
        b = (2.0 * y + 1.0 + (GAUSS if corner & 2 else -GAUSS)) / size - 1.0
        chord2, length = _chord2(frame, direction, a, b)
        weight += _lobe(chord2, alpha) / (length * length * length)
    return weight / (size * size)


@compiled()
def _look_at(frame, direction, x, y, size, lobe):
    """Return whether the lobe reaches a square, and whether the square is to be cut."""
    alpha, total, _, tolerance = lobe
    chord2, length = _chord2(frame, direction, (2.0 * x + 1.0) / size - 1.0, (2.0 * y + 1.0) / size - 1.0)
    area = 4.0 / (size * size * length * length * length)
    extent = math.sqrt(area)
    near = max(math.sqrt(chord2) - 0.75 * extent, 0.0)  # about the closest point of the square
    share = min(area * _lobe(near * near, alpha) / total, 1.0)
    return share > 0.0, share * extent > tolerance * math.sqrt(4.0 * alpha * alpha + near * near)


@compiled()
def _refine_row(direction, frames, lobe, index, weight, write):
    """Refine one row's pyramid from the top, depth first; count its entries, and write them if asked to.

    All parts of a texel follow one another in this order, so they add up in the entry written last.
    """
    alpha, _, resolution, _ = lobe
    stack = np.empty((DEEPEST, 4), np.int64)
    top, count, last = 6 * ROOT * ROOT, 0, -1
    for root in range(top):
        stack[root] = (ROOT, root // (ROOT * ROOT), root // ROOT % ROOT, root % ROOT)
    while top > 0:
        top -= 1
        size, face, y, x = stack[top]
        reached, deeper = _look_at(frames[face], direction, x, y, size, lobe)
        if not reached:
            continue
        if deeper and top + 4 <= len(stack):
            for quarter in range(4):
                stack[top + quarter] = (2 * size, face, 2 * y + quarter // 2, 2 * x + quarter % 2)
            top += 4
            continue
        ratio = max(size // resolution, 1)
        level = size // ratio
        node = _pyramid_offset(level) + (face * level + y // ratio) * level + x // ratio
        if node != last:
            last = node
            count += 1
            if write:
                index[count - 1], weight[count - 1] = node, 0.0
        if write:
            weight[count - 1] += _square_weight(frames[face], direction, x, y, size, alpha)
    return count


@compiled(parallel=True)
def refine(directions, frames, lobe, start, counts, index, weight, write):
    """Refine all rows: count the entries of each, and write them from `start` on if asked to."""
    for row in prange(len(directions)):
        entries, weights = index[start[row] :], weight[start[row] :]
        counts[row] = _refine_row(directions[row], frames, lobe, entries, weights, write)

"""Numba backend of the rasteriser: faces are sorted into horizontal bands, and each thread draws its own bands.

Within a band faces come in index order and replace only what is strictly farther, so ties go to the lower
index. The arithmetic is float64 and, without fused operations, the reference's to the bit.
"""

import numpy as np
import torch
from numba import prange
from torch import Tensor

from lightprobe.core.jit import arrays, compiled, threads

BAND = 16  # rows


def rasterize(screen: Tensor, faces: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Return face (H, W) int32 and inverse depth (H, W) float32."""
    face = torch.full((height, width), -1, dtype=torch.int32)
    inverse_depth = torch.zeros(height, width)
    points, triangles = arrays(screen, faces)
    workers = threads(32 * faces.shape[0] + height * width)
    span = _bands(points, triangles, height, width)
    first, order = _sort_into_bands(span, (height + BAND - 1) // BAND)
    _draw(points, triangles, first, order, workers, face.numpy(), inverse_depth.numpy())
    return face, inverse_depth


@compiled()
def _pixels(low, high, size):
    """Return the first and last pixel whose centre lies in [low, high]; first > last when there is none."""
    return int(min(max(np.ceil(low - 0.5), 0.0), size)), int(max(min(np.floor(high - 0.5), size - 1.0), -1.0))


@compiled()
def _box(points, a, b, c, height, width):
    """Return left, right, top and bottom pixel of a face; right < left when there is nothing to draw."""
    total, nearest = 0.0, np.inf
    for vertex in (a, b, c):
        total += abs(points[vertex, 0]) + abs(points[vertex, 1]) + abs(points[vertex, 2])
        nearest = min(nearest, points[vertex, 2])
    if not (nearest > 0 and total < np.inf):  # written so that NaN fails
        return 0, -1, 0, -1
    xs = np.float64(points[a, 0]), np.float64(points[b, 0]), np.float64(points[c, 0])
    ys = np.float64(points[a, 1]), np.float64(points[b, 1]), np.float64(points[c, 1])
    left, right = _pixels(min(xs), max(xs), width)
    top, bottom = _pixels(min(ys), max(ys), height)
    return left, right, top, bottom


@compiled(parallel=True)
def _bands(points, faces, height, width):
    """Return the first and last band each face touches (F, 2); last < first when none."""
    span = np.empty((faces.shape[0], 2), np.int32)
    for f in prange(faces.shape[0]):
        left, right, top, bottom = _box(points, faces[f, 0], faces[f, 1], faces[f, 2], height, width)
        empty = right < left or bottom < top
        span[f, 0] = 0 if empty else top // BAND
        span[f, 1] = -1 if empty else bottom // BAND
    return span


@compiled()
def _sort_into_bands(span, bands):
    """Return where each band starts (bands + 1,) in the list of its faces, and that list, in face order."""
    first = np.zeros(bands + 2, np.int64)
    for f in range(span.shape[0]):
        for band in range(span[f, 0], span[f, 1] + 1):
            first[band + 2] += 1
    for band in range(bands):
        first[band + 2] += first[band + 1]
    order = np.empty(first[bands + 1], np.int32)
    for f in range(span.shape[0]):
        for band in range(span[f, 0], span[f, 1] + 1):
            order[first[band + 1]] = f
            first[band + 1] += 1
    return first, order


@compiled(parallel=True)
def _draw(points, faces, first, order, workers, face_out, depth_out):
    height = face_out.shape[0]
    bands = (height + BAND - 1) // BAND
    for worker in prange(workers):
        for band in range(worker, bands, workers):
            bottom = min(height, (band + 1) * BAND) - 1
            for position in range(first[band], first[band + 1]):
                _draw_face(points, faces, order[position], band * BAND, bottom, face_out, depth_out)


@compiled()
def _edge(points, p, q, sign):
    """Return start x, y, run and rise of an edge, from its lexicographically smaller end, times its sign."""
    px, py = np.float64(points[p, 0]), np.float64(points[p, 1])
    qx, qy = np.float64(points[q, 0]), np.float64(points[q, 1])
    if qx < px or (qx == px and qy < py):
        return qx, qy, -sign * (px - qx), -sign * (py - qy)
    return px, py, sign * (qx - px), sign * (qy - py)


@compiled()
def _draw_face(points, faces, f, top, bottom, face_out, depth_out):
    """Draw the rows top..bottom of one face."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    left, right, box_top, box_bottom = _box(points, a, b, c, *face_out.shape)
    ax, ay = np.float64(points[a, 0]), np.float64(points[a, 1])
    area = (points[b, 0] - ax) * (points[c, 1] - ay) - (points[b, 1] - ay) * (points[c, 0] - ax)
    if area == 0:
        return
    sign = 1.0 if area > 0 else -1.0
    x0, y0, run0, rise0 = _edge(points, b, c, sign)
    x1, y1, run1, rise1 = _edge(points, c, a, sign)
    x2, y2, run2, rise2 = _edge(points, a, b, sign)
    wa, wb, wc = 1 / np.float64(points[a, 2]), 1 / np.float64(points[b, 2]), 1 / np.float64(points[c, 2])
    for i in range(max(top, box_top), min(bottom, box_bottom) + 1):
        y = i + 0.5
        row0, row1, row2 = run0 * (y - y0), run1 * (y - y1), run2 * (y - y2)
        for j in range(left, right + 1):
            x = j + 0.5
            e0, e1, e2 = row0 - rise0 * (x - x0), row1 - rise1 * (x - x1), row2 - rise2 * (x - x2)
            total = e0 + e1 + e2
            if e0 >= 0 and e1 >= 0 and e2 >= 0 and total > 0:
                value = np.float32((e0 * wa + e1 * wb + e2 * wc) / total)
                if value > depth_out[i, j]:
                    depth_out[i, j] = value
                    face_out[i, j] = f

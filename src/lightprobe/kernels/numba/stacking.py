"""Numba body of the stacking; symbols as in `lightprobe.kernels.stacking` and `lobe_frames`.

Loops run over a tile of texels in vectors; tile by tile the sums stay in the first-level cache, and partial sums over
`CHUNK` pixels or `TILE` texels keep the rounding of long float32 sums small.
"""

import math

import numpy as np
import torch
from numba import prange
from torch import Tensor

from lightprobe.core.jit import arrays, compiled, threads
from lightprobe.kernels.lobe_frames import lobe_frames

TILE = 256  # texels
CHUNK = 512  # pixels
BLOCK = 64  # pixels that one thread takes through all tiles
TINY = np.float32(1e-30)  # makes (k + s^2)/(k + a2 s^2) one where w = -v
ZERO = np.float32(0)
FUSED = {"contract", "arcp", "nsz", "nnan", "ninf"}


def stack(colors: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
    """Return sum_p c_p D_p (M, 3) and sum_p D_p (M,)."""
    scale = alpha2[:, None] / math.pi
    factors = torch.cat([scale, scale * colors], dim=1)
    out = colors.new_zeros(4, directions.shape[0])
    threads(normals.shape[0] * directions.shape[0])
    _stack(*arrays(lobe_frames(normals, views, alpha2), factors, directions.T), out.numpy())
    return out[1:].T.contiguous(), out[0]


def stack_backward(grad: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor) -> Tensor:
    """Return sum_w D_p(w) grad(w), shape (N, 3), for `grad` (M, 3) already divided by W."""
    out = grad.new_zeros(normals.shape[0], 3)
    threads(normals.shape[0] * directions.shape[0])
    _stack_backward(*arrays(lobe_frames(normals, views, alpha2), grad.T, directions.T), out.numpy())
    return out * (alpha2[:, None] / math.pi)


@compiled(fastmath=FUSED, inline="always")
def _lobe(frame, p, x, y, z):
    """Return pi D / a2 of pixel p in the direction (x, y, z)."""
    across = frame[p, 3] + frame[p, 0] * x + frame[p, 1] * y + frame[p, 2] * z
    along = frame[p, 7] + frame[p, 4] * x + frame[p, 5] * y + frame[p, 6] * z
    cosine = frame[p, 8] * x + frame[p, 9] * y + frame[p, 10] * z
    k = TINY + across * across + along * along
    s = frame[p, 11] + cosine
    ratio = (k + s * s) / (k + frame[p, 12] * (s * s))
    return ratio * ratio * max(cosine, ZERO)


@compiled(parallel=True, fastmath=FUSED)
def _stack(frame, factors, directions, out):
    for tile in prange((directions.shape[1] + TILE - 1) // TILE):
        _stack_tile(frame, factors, directions, tile * TILE, min(directions.shape[1], (tile + 1) * TILE), out)


@compiled(fastmath=FUSED)
def _stack_tile(frame, factors, directions, start, stop, out):
    x, y, z = directions[0, start:stop], directions[1, start:stop], directions[2, start:stop]
    sums = np.zeros((4, TILE), np.float32)
    w, r, g, b = sums[0], sums[1], sums[2], sums[3]
    for first in range(0, frame.shape[0], CHUNK):
        for p in range(first, min(frame.shape[0], first + CHUNK)):
            for j in range(x.size):
                lobe = _lobe(frame, p, x[j], y[j], z[j])
                w[j] += factors[p, 0] * lobe
                r[j] += factors[p, 1] * lobe
                g[j] += factors[p, 2] * lobe
                b[j] += factors[p, 3] * lobe
        for channel in range(4):
            for j in range(x.size):
                out[channel, start + j] += sums[channel, j]
                sums[channel, j] = ZERO


@compiled(parallel=True, fastmath=FUSED)
def _stack_backward(frame, grad, directions, out):
    for block in prange((frame.shape[0] + BLOCK - 1) // BLOCK):
        _project_block(frame, grad, directions, block * BLOCK, min(frame.shape[0], (block + 1) * BLOCK), out)


@compiled(fastmath=FUSED | {"reassoc"})
def _project_block(frame, grad, directions, begin, end, out):
    for start in range(0, directions.shape[1], TILE):
        part = slice(start, min(directions.shape[1], start + TILE))
        x, y, z = directions[0, part], directions[1, part], directions[2, part]
        red, green, blue = grad[0, part], grad[1, part], grad[2, part]
        for p in range(begin, end):
            r, g, b = ZERO, ZERO, ZERO
            for j in range(x.size):
                lobe = _lobe(frame, p, x[j], y[j], z[j])
                r += lobe * red[j]
                g += lobe * green[j]
                b += lobe * blue[j]
            out[p, 0] += r
            out[p, 1] += g
            out[p, 2] += b

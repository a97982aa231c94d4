"""Numba backend of the stacking; symbols as in `lightprobe.kernels.stacking`.

Loops run over a tile of texels in vectors; tile by tile the sums stay in the first-level cache, and partial
sums over `CHUNK` pixels or `TILE` texels keep the rounding of long float32 sums small.
"""

import math

import numpy as np
import torch
from numba import prange
from torch import Tensor

from lightprobe.core.jit import arrays, compiled, threads
from lightprobe.kernels.stacking import lobe_frames

TILE = 256  # texels
CHUNK = 512  # pixels
BLOCK = 64  # pixels that one thread takes through all tiles
TINY = np.float32(1e-30)  # makes (k + s^2)/(k + a2 s^2) one where w = -v
ZERO = np.float32(0)
FUSED = {"contract", "arcp", "nsz", "nnan", "ninf"}


def stack(
    colors: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """Return sum_p c_p D_p (M, 3) and sum_p D_p (M,)."""
    scale = alpha2[:, None] / math.pi
    factors = torch.cat([scale, scale * colors], dim=1)
    out = colors.new_zeros(4, directions.shape[0])
    threads(normals.shape[0] * directions.shape[0])
    _stack(*arrays(lobe_frames(normals, views, alpha2), factors, directions.T), out.numpy())
    return out[1:].T.contiguous(), out[0]


def stack_backward(
    grad: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor
) -> Tensor:
    """Return sum_w D_p(w) grad(w), shape (N, 3), for `grad` (M, 3) already divided by W."""
    out = grad.new_zeros(normals.shape[0], 3)
    threads(normals.shape[0] * directions.shape[0])
    _stack_backward(*arrays(lobe_frames(normals, views, alpha2), grad.T, directions.T), out.numpy())
    return out * (alpha2[:, None] / math.pi)


@compiled(fastmath=FUSED, inline="always")
def pixel_frame(values, p):
    """Return the frame of pixel p as numbers, which a loop that writes elsewhere can keep in registers."""
    tx, ty, tz, tv = values[p, 0], values[p, 1], values[p, 2], values[p, 3]
    bx, by, bz, bv = values[p, 4], values[p, 5], values[p, 6], values[p, 7]
    nx, ny, nz, nv = values[p, 8], values[p, 9], values[p, 10], values[p, 11]
    return tx, ty, tz, tv, bx, by, bz, bv, nx, ny, nz, nv, values[p, 12]


@compiled(fastmath=FUSED, inline="always")
def components(frame, x, y, z):
    """Return k, s and n.w in the direction (x, y, z) for a `pixel_frame`."""
    tx, ty, tz, tv, bx, by, bz, bv, nx, ny, nz, nv, _ = frame
    across = tv + tx * x + ty * y + tz * z
    along = bv + bx * x + by * y + bz * z
    cosine = nx * x + ny * y + nz * z
    return TINY + across * across + along * along, nv + cosine, cosine


@compiled(fastmath=FUSED, inline="always")
def lobe(frame, x, y, z):
    """Return pi D / a2 in the direction (x, y, z) for a `pixel_frame`."""
    k, s, cosine = components(frame, x, y, z)
    ratio = (k + s * s) / (k + frame[12] * (s * s))
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
            own = pixel_frame(frame, p)
            one, red, green, blue = factors[p, 0], factors[p, 1], factors[p, 2], factors[p, 3]
            for j in range(x.size):
                value = lobe(own, x[j], y[j], z[j])
                w[j] += one * value
                r[j] += red * value
                g[j] += green * value
                b[j] += blue * value
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
            own = pixel_frame(frame, p)
            r, g, b = ZERO, ZERO, ZERO
            for j in range(x.size):
                value = lobe(own, x[j], y[j], z[j])
                r += value * red[j]
                g += value * green[j]
                b += value * blue[j]
            out[p, 0] += r
            out[p, 1] += g
            out[p, 2] += b

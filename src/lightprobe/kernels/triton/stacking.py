"""Triton backend of the stacking; symbols as in `lightprobe.kernels.stacking`.

Forward: a program holds a block of texels and walks through a share of the pixels; backward: it holds a block
of pixels and walks through a share of the texels. What it walks through is read as scalars, which every lane
shares. The shares depend on the sizes alone and their partial sums are added in order, so the bits repeat.
"""

import math

import torch
import triton
import triton.language as tl
from torch import Tensor

from lightprobe.kernels.stacking import lobe_frames

TEXELS = 1024  # of one program, forward
PIXELS = 256  # of one program, backward
CHUNK = 256  # terms summed before they join the total: keeps the rounding of long float32 sums small
PROGRAMS = 2048  # wanted: a few for each multiprocessor of a large GPU


def stack(
    colors: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """Return sum_p c_p D_p (M, 3) and sum_p D_p (M,)."""
    pixels, texels = normals.shape[0], directions.shape[0]
    if pixels == 0 or texels == 0:
        return colors.new_zeros(texels, 3), colors.new_zeros(texels)
    scale = alpha2[:, None] / math.pi
    lobes = torch.cat([lobe_frames(normals, views, alpha2), scale, scale * colors], dim=1)
    blocks = triton.cdiv(texels, TEXELS)
    share = _share(pixels, blocks)
    parts = colors.new_empty(triton.cdiv(pixels, share), 4, texels)
    with torch.cuda.device_of(colors):
        sizes = pixels, texels, share, CHUNK, TEXELS
        _stack[(blocks, parts.shape[0])](lobes, directions.contiguous(), parts, *sizes, enable_fp_fusion=True)
    out = parts.sum(0)
    return out[1:].T.contiguous(), out[0]


def stack_backward(
    grad: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor
) -> Tensor:
    """Return sum_w D_p(w) grad(w), shape (N, 3), for `grad` (M, 3) already divided by W."""
    pixels, texels = normals.shape[0], directions.shape[0]
    if pixels == 0 or texels == 0:
        return grad.new_zeros(pixels, 3)
    lobes = lobe_frames(normals, views, alpha2).T.contiguous()
    lights = torch.cat([directions, grad], dim=1)
    blocks = triton.cdiv(pixels, PIXELS)
    share = _share(texels, blocks)
    parts = grad.new_empty(triton.cdiv(texels, share), 3, pixels)
    with torch.cuda.device_of(grad):
        sizes = pixels, texels, share, CHUNK, PIXELS
        _project[(blocks, parts.shape[0])](lobes, lights, parts, *sizes, enable_fp_fusion=True)
    return parts.sum(0).T * (alpha2[:, None] / math.pi)


def _share(terms: int, blocks: int) -> int:
    """Return how many of the terms one program walks through: whole chunks."""
    wanted = triton.cdiv(terms * blocks, PROGRAMS)
    return CHUNK * max(1, triton.cdiv(wanted, CHUNK))


@triton.jit
def _lobe(tx, ty, tz, tv, bx, by, bz, bv, nx, ny, nz, nv, a2, x, y, z):
    """Return pi D / a2."""
    across = tv + tx * x + ty * y + tz * z
    along = bv + bx * x + by * y + bz * z
    cosine = nx * x + ny * y + nz * z
    k = 1e-30 + across * across + along * along  # so that k / k is one where w = -v
    s = nv + cosine
    ratio = (k + s * s) / (k + a2 * (s * s))
    return ratio * ratio * tl.where(cosine < 0, 0.0, cosine)  # so written that NaN stays visible


@triton.jit
def _stack(lobes, directions, parts, pixels, texels, share, CHUNK: tl.constexpr, TEXELS: tl.constexpr):
    j = tl.program_id(0).to(tl.int64) * TEXELS + tl.arange(0, TEXELS)
    live = j < texels
    x = tl.load(directions + 3 * j, mask=live, other=0.0)
    y = tl.load(directions + 3 * j + 1, mask=live, other=0.0)
    z = tl.load(directions + 3 * j + 2, mask=live, other=0.0)
    weight = tl.zeros([TEXELS], dtype=tl.float32)
    red, green, blue = weight, weight, weight
    begin = tl.program_id(1) * share
    end = tl.minimum(begin + share, pixels)
    for first in range(begin, end, CHUNK):
        w = tl.zeros([TEXELS], dtype=tl.float32)
        r, g, b = w, w, w
        for p in range(first, tl.minimum(first + CHUNK, end)):
            at = lobes + p * 17
            tx, ty, tz, tv = tl.load(at), tl.load(at + 1), tl.load(at + 2), tl.load(at + 3)
            bx, by, bz, bv = tl.load(at + 4), tl.load(at + 5), tl.load(at + 6), tl.load(at + 7)
            nx, ny, nz, nv = tl.load(at + 8), tl.load(at + 9), tl.load(at + 10), tl.load(at + 11)
            lobe = _lobe(tx, ty, tz, tv, bx, by, bz, bv, nx, ny, nz, nv, tl.load(at + 12), x, y, z)
            w += tl.load(at + 13) * lobe
            r += tl.load(at + 14) * lobe
            g += tl.load(at + 15) * lobe
            b += tl.load(at + 16) * lobe
        weight += w
        red += r
        green += g
        blue += b
    out = parts + tl.program_id(1).to(tl.int64) * 4 * texels + j
    tl.store(out, weight, mask=live)
    tl.store(out + texels, red, mask=live)
    tl.store(out + 2 * texels, green, mask=live)
    tl.store(out + 3 * texels, blue, mask=live)


@triton.jit
def _project(lobes, lights, parts, pixels, texels, share, CHUNK: tl.constexpr, PIXELS: tl.constexpr):
    p = tl.program_id(0).to(tl.int64) * PIXELS + tl.arange(0, PIXELS)
    live = p < pixels
    at = lobes + p
    tx, ty, tz = _column(at, 0, pixels, live), _column(at, 1, pixels, live), _column(at, 2, pixels, live)
    tv = _column(at, 3, pixels, live)
    bx, by, bz = _column(at, 4, pixels, live), _column(at, 5, pixels, live), _column(at, 6, pixels, live)
    bv = _column(at, 7, pixels, live)
    nx, ny, nz = _column(at, 8, pixels, live), _column(at, 9, pixels, live), _column(at, 10, pixels, live)
    nv, a2 = _column(at, 11, pixels, live), _column(at, 12, pixels, live)
    red = tl.zeros([PIXELS], dtype=tl.float32)
    green, blue = red, red
    begin = tl.program_id(1) * share
    end = tl.minimum(begin + share, texels)
    for first in range(begin, end, CHUNK):
        r = tl.zeros([PIXELS], dtype=tl.float32)
        g, b = r, r
        for j in range(first, tl.minimum(first + CHUNK, end)):
            light = lights + j * 6
            x, y, z = tl.load(light), tl.load(light + 1), tl.load(light + 2)
            lobe = _lobe(tx, ty, tz, tv, bx, by, bz, bv, nx, ny, nz, nv, a2, x, y, z)
            r += tl.load(light + 3) * lobe
            g += tl.load(light + 4) * lobe
            b += tl.load(light + 5) * lobe
        red += r
        green += g
        blue += b
    out = parts + tl.program_id(1).to(tl.int64) * 3 * pixels + p
    tl.store(out, red, mask=live)
    tl.store(out + pixels, green, mask=live)
    tl.store(out + 2 * pixels, blue, mask=live)


@triton.jit
def _column(at, number, pixels, live):
    return tl.load(at + number * pixels, mask=live, other=0.0)

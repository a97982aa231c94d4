"""Triton backend of the occluded light; symbols as in `lightprobe.kernels.occlusion`.

What is summed over directions has one program per pixel, whose lanes are directions, so that the bytes of an
unoccluded row are read side by side. What is summed over pixels has lanes of directions too, and walks
through a share of pixels.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

# Whole operations of PyTorch, limited by memory.
from lightprobe.kernels.reference.occlusion import weights as weights

DIRECTIONS = 512  # of one program, summed over at once
LANES = 128  # directions of one program that walks through pixels
SHARE = 64  # pixels it walks through
TINY = 1e-12  # keeps a division by nothing finite


def occluded_light(light: Tensor, normals: Tensor, *rest: Tensor) -> Tensor:
    """Return diffuse, ambient and open (P, 7)."""
    unoccluded, index, weight, directions, angles = rest
    out = light.new_empty(normals.shape[0], 7)
    if len(out):
        with torch.cuda.device_of(light):
            case = (*_pixels(normals, unoccluded, index, weight), _sphere(light, directions, angles), out)
            _forward[(len(out),)](*case, *_sizes(unoccluded, index), TINY, num_warps=1, enable_fp_fusion=True)
    return out


def light_gradient(grad: Tensor, normals: Tensor, *rest: Tensor) -> Tensor:
    """Return the gradient (K, 3) of the light."""
    unoccluded, index, weight, directions, angles = rest
    count, bins = normals.shape[0], directions.shape[0]
    if count == 0 or bins == 0:
        return grad.new_zeros(bins, 3)
    sphere = _sphere(torch.zeros_like(directions), directions, angles)
    pixels = _pixels(normals, unoccluded, index, weight)
    sums = grad.new_empty(count, 2)
    parts = grad.new_empty(triton.cdiv(count, SHARE), 3, bins)
    with torch.cuda.device_of(grad):
        sizes = _sizes(unoccluded, index)
        _totals[(count,)](*pixels, sphere, sums, *sizes, num_warps=1, enable_fp_fusion=True)
        sums = sums.clamp(min=TINY)
        arriving = torch.cat([grad[:, :3] / sums[:, :1], grad[:, 3:6] / sums[:, 1:]], dim=1)
        grid = (triton.cdiv(bins, LANES), parts.shape[0])
        shares = bins, count, index.shape[1], LANES, SHARE
        _spread[grid](*pixels, sphere, arriving, parts, *shares, enable_fp_fusion=True)
    return parts.sum(0).T.contiguous()


def normal_gradient(grad: Tensor, out: Tensor, light: Tensor, normals: Tensor, *rest: Tensor) -> Tensor:
    """Return the gradient (P, 3) of the normals, for the forward result `out`."""
    unoccluded, index, weight, directions, angles = rest
    result = torch.empty_like(normals, memory_format=torch.contiguous_format)
    if len(out):
        mean = (grad[:, :3] * out[:, :3]).sum(1, keepdim=True) + grad[:, 6:] * out[:, 6:]
        pull = torch.cat([grad[:, :3], grad[:, 6:], mean], dim=1)
        with torch.cuda.device_of(grad):
            pixels, sphere = _pixels(normals, unoccluded, index, weight), _sphere(light, directions, angles)
            case = (*pixels, sphere, pull, result)
            _turn[(len(out),)](*case, *_sizes(unoccluded, index), TINY, num_warps=1, enable_fp_fusion=True)
    return result


def _pixels(normals: Tensor, unoccluded: Tensor, index: Tensor, weight: Tensor) -> tuple[Tensor, ...]:
    return normals.contiguous(), unoccluded.contiguous(), index.contiguous(), (weight / 255).contiguous()


def _sphere(light: Tensor, directions: Tensor, angles: Tensor) -> Tensor:
    """Return (7, K): x, y, z, solid angle, red, green, blue."""
    return torch.cat([directions.T, angles[None], light.T]).contiguous()


def _sizes(unoccluded: Tensor, index: Tensor) -> tuple[int, int, int]:
    """Return the number of directions, how many of them one program sums over at once, and corners per pixel."""
    bins = unoccluded.shape[1]
    return bins, min(DIRECTIONS, triton.next_power_of_2(max(bins, 1))), index.shape[1]


@triton.jit
def _open(unoccluded, index, weight, p, k, live, bins, CORNERS: tl.constexpr):
    """Return the unoccluded v of pixel p in the directions k."""
    share = tl.zeros(k.shape, dtype=tl.float32)
    for c in tl.static_range(CORNERS):
        row = tl.load(index + p * CORNERS + c).to(tl.int64)
        byte = tl.load(unoccluded + row * bins + k, mask=live, other=0)
        share += tl.load(weight + p * CORNERS + c) * byte.to(tl.float32)
    return share


@triton.jit
def _cosine(normals, p, sphere, k, live, bins):
    """Return n.w and the solid angle; both 0 beyond the last direction."""
    x = tl.load(sphere + k, mask=live, other=0.0)
    y = tl.load(sphere + bins + k, mask=live, other=0.0)
    z = tl.load(sphere + 2 * bins + k, mask=live, other=0.0)
    angle = tl.load(sphere + 3 * bins + k, mask=live, other=0.0)
    normal = normals + 3 * p
    return tl.load(normal) * x + tl.load(normal + 1) * y + tl.load(normal + 2) * z, angle


@triton.jit
def _forward(
    normals,
    unoccluded,
    index,
    weight,
    sphere,
    out,
    bins,
    BLOCK: tl.constexpr,
    CORNERS: tl.constexpr,
    TINY: tl.constexpr,
):
    p = tl.program_id(0).to(tl.int64)
    total, share, r, g, b = 0.0, 0.0, 0.0, 0.0, 0.0
    around, ar, ag, ab = 0.0, 0.0, 0.0, 0.0
    for first in range(0, bins, BLOCK):
        k = first + tl.arange(0, BLOCK)
        live = k < bins
        cosine, angle = _cosine(normals, p, sphere, k, live, bins)
        cosine = tl.maximum(cosine, 0.0)
        ambient = _open(unoccluded, index, weight, p, k, live, bins, CORNERS) * angle
        seen = ambient * cosine
        red = tl.load(sphere + 4 * bins + k, mask=live, other=0.0)
        green = tl.load(sphere + 5 * bins + k, mask=live, other=0.0)
        blue = tl.load(sphere + 6 * bins + k, mask=live, other=0.0)
        total += tl.sum(cosine * angle, axis=0)
        share += tl.sum(seen, axis=0)
        r += tl.sum(seen * red, axis=0)
        g += tl.sum(seen * green, axis=0)
        b += tl.sum(seen * blue, axis=0)
        around += tl.sum(ambient, axis=0)
        ar += tl.sum(ambient * red, axis=0)
        ag += tl.sum(ambient * green, axis=0)
        ab += tl.sum(ambient * blue, axis=0)
    total = tl.maximum(total, TINY)
    around = tl.maximum(around, TINY)
    at = out + 7 * p
    tl.store(at, r / total)
    tl.store(at + 1, g / total)
    tl.store(at + 2, b / total)
    tl.store(at + 3, ar / around)
    tl.store(at + 4, ag / around)
    tl.store(at + 5, ab / around)
    tl.store(at + 6, share / total)


@triton.jit
def _totals(
    normals, unoccluded, index, weight, sphere, sums, bins, BLOCK: tl.constexpr, CORNERS: tl.constexpr
):
    """Write the sum of c and the sum of dw v of each pixel."""
    p = tl.program_id(0).to(tl.int64)
    total, around = 0.0, 0.0
    for first in range(0, bins, BLOCK):
        k = first + tl.arange(0, BLOCK)
        live = k < bins
        cosine, angle = _cosine(normals, p, sphere, k, live, bins)
        total += tl.sum(tl.maximum(cosine, 0.0) * angle, axis=0)
        around += tl.sum(_open(unoccluded, index, weight, p, k, live, bins, CORNERS) * angle, axis=0)
    tl.store(sums + 2 * p, total)
    tl.store(sums + 2 * p + 1, around)


@triton.jit
def _spread(
    normals,
    unoccluded,
    index,
    weight,
    sphere,
    arriving,
    parts,
    bins,
    count,
    CORNERS: tl.constexpr,
    LANES: tl.constexpr,
    SHARE: tl.constexpr,
):
    """Sum v dw (max(n.w, 0) diffuse + ambient) over a share of the pixels."""
    k = tl.program_id(0) * LANES + tl.arange(0, LANES)
    live = k < bins
    r = tl.zeros([LANES], dtype=tl.float32)
    g, b = r, r
    begin = tl.program_id(1).to(tl.int64) * SHARE
    for p in range(begin, tl.minimum(begin + SHARE, count)):
        cosine, angle = _cosine(normals, p, sphere, k, live, bins)
        cosine = tl.maximum(cosine, 0.0)
        reached = _open(unoccluded, index, weight, p, k, live, bins, CORNERS) * angle
        at = arriving + 6 * p
        r += reached * (cosine * tl.load(at) + tl.load(at + 3))
        g += reached * (cosine * tl.load(at + 1) + tl.load(at + 4))
        b += reached * (cosine * tl.load(at + 2) + tl.load(at + 5))
    out = parts + tl.program_id(1).to(tl.int64) * 3 * bins + k
    tl.store(out, r, mask=live)
    tl.store(out + bins, g, mask=live)
    tl.store(out + 2 * bins, b, mask=live)


@triton.jit
def _turn(
    normals,
    unoccluded,
    index,
    weight,
    sphere,
    pull,
    result,
    bins,
    BLOCK: tl.constexpr,
    CORNERS: tl.constexpr,
    TINY: tl.constexpr,
):
    p = tl.program_id(0).to(tl.int64)
    at = pull + 5 * p
    gr, gg, gb, ga, mean = tl.load(at), tl.load(at + 1), tl.load(at + 2), tl.load(at + 3), tl.load(at + 4)
    total, ox, oy, oz = 0.0, 0.0, 0.0, 0.0
    for first in range(0, bins, BLOCK):
        k = first + tl.arange(0, BLOCK)
        live = k < bins
        cosine, angle = _cosine(normals, p, sphere, k, live, bins)
        facing = tl.where(cosine > 0, angle, 0.0)
        red = tl.load(sphere + 4 * bins + k, mask=live, other=0.0)
        green = tl.load(sphere + 5 * bins + k, mask=live, other=0.0)
        blue = tl.load(sphere + 6 * bins + k, mask=live, other=0.0)
        arriving = gr * red + gg * green + gb * blue + ga
        force = facing * (_open(unoccluded, index, weight, p, k, live, bins, CORNERS) * arriving - mean)
        total += tl.sum(facing * cosine, axis=0)
        ox += tl.sum(force * tl.load(sphere + k, mask=live, other=0.0), axis=0)
        oy += tl.sum(force * tl.load(sphere + bins + k, mask=live, other=0.0), axis=0)
        oz += tl.sum(force * tl.load(sphere + 2 * bins + k, mask=live, other=0.0), axis=0)
    total = tl.maximum(total, TINY)
    tl.store(result + 3 * p, ox / total)
    tl.store(result + 3 * p + 1, oy / total)
    tl.store(result + 3 * p + 2, oz / total)

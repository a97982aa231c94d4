"""Numba backend of the occluded light; symbols as in `lightprobe.kernels.occlusion`.

A thread takes a block of pixels; per pixel the unoccluded of all directions is gathered into a row that stays
in the first-level cache, and the sums run over it in vectors.
"""

import numpy as np
import torch
from numba import prange
from torch import Tensor

from lightprobe.core.jit import arrays, compiled, threads

BLOCK = 256  # pixels that one thread takes at a time; partial light gradients are summed block by block
TINY = np.float32(1e-12)
ZERO = np.float32(0)
# No more flags: with `nsz` and `nnan`, last bits of loops compiled in the process differ from loops of Numba's cache,
# which are optimised once more.
FUSED = {"contract", "reassoc"}


def occluded_light(light: Tensor, normals: Tensor, *rest: Tensor) -> Tensor:
    """Return diffuse, ambient and open (P, 7)."""
    unoccluded, index, weight, directions, angles = rest
    out = light.new_empty(normals.shape[0], 7)
    (sphere,) = arrays(_sphere(light, directions, angles))
    threads(2 * normals.shape[0] * directions.shape[0])
    _forward(*arrays(normals, index, weight / 255), unoccluded.contiguous().numpy(), sphere, out.numpy())
    return out


def light_gradient(grad: Tensor, normals: Tensor, *rest: Tensor) -> Tensor:
    """Return the gradient (K, 3) of the light."""
    unoccluded, index, weight, directions, angles = rest
    blocks = -(-normals.shape[0] // BLOCK)
    parts = grad.new_zeros(blocks, 3, directions.shape[0])
    pixels = arrays(normals, index, weight / 255, grad)
    (sphere,) = arrays(torch.cat([directions.T, angles[None]]))
    threads(2 * normals.shape[0] * directions.shape[0])
    _light_gradient(*pixels, unoccluded.contiguous().numpy(), sphere, parts.numpy())
    return parts.sum(0).T.contiguous()


def normal_gradient(grad: Tensor, out: Tensor, light: Tensor, normals: Tensor, *rest: Tensor) -> Tensor:
    """Return the gradient (P, 3) of the normals, for the forward result `out`."""
    unoccluded, index, weight, directions, angles = rest
    result = torch.empty_like(normals)
    pixels = arrays(normals, index, weight / 255, grad, out)
    (sphere,) = arrays(_sphere(light, directions, angles))
    threads(2 * normals.shape[0] * directions.shape[0])
    _normal_gradient(*pixels, unoccluded.contiguous().numpy(), sphere, result.numpy())
    return result


def weights(out: Tensor, normals: Tensor, *rest: Tensor) -> None:
    """Fill `out` (2, P, K) with the weights of diffuse and ambient."""
    unoccluded, index, weight, directions, angles = rest
    (sphere,) = arrays(torch.cat([directions.T, angles[None]]))
    threads(2 * normals.shape[0] * directions.shape[0])
    _weights(*arrays(normals, index, weight / 255), unoccluded.contiguous().numpy(), sphere, out.numpy())


def _sphere(light: Tensor, directions: Tensor, angles: Tensor) -> Tensor:
    """Return (7, K): x, y, z, solid angle, red, green, blue."""
    return torch.cat([directions.T, angles[None], light.T])


@compiled(fastmath=FUSED, inline="always")
def _gather(unoccluded, index, weight, p, row):
    """Write the unoccluded v of all directions into `row`."""
    first, share = index[p, 0], weight[p, 0]
    for k in range(row.size):
        row[k] = share * np.float32(unoccluded[first, k])
    for c in range(1, index.shape[1]):
        other, share = index[p, c], weight[p, c]
        for k in range(row.size):
            row[k] += share * np.float32(unoccluded[other, k])


@compiled(parallel=True, fastmath=FUSED)
def _forward(normals, index, weight, unoccluded, sphere, out):
    for block in prange((normals.shape[0] + BLOCK - 1) // BLOCK):
        row = np.empty(sphere.shape[1], np.float32)
        for p in range(block * BLOCK, min(normals.shape[0], (block + 1) * BLOCK)):
            _gather(unoccluded, index, weight, p, row)
            _pixel(normals[p, 0], normals[p, 1], normals[p, 2], row, sphere, out, p)


@compiled(fastmath=FUSED)
def _pixel(nx, ny, nz, row, sphere, out, p):
    x, y, z, angle = sphere[0], sphere[1], sphere[2], sphere[3]
    red, green, blue = sphere[4], sphere[5], sphere[6]
    total, share, r, g, b = ZERO, ZERO, ZERO, ZERO, ZERO
    around, ar, ag, ab = ZERO, ZERO, ZERO, ZERO
    for k in range(row.size):
        cosine = max(nx * x[k] + ny * y[k] + nz * z[k], ZERO)
        ambient = row[k] * angle[k]
        seen = ambient * cosine
        total += cosine * angle[k]
        share += seen
        r += seen * red[k]
        g += seen * green[k]
        b += seen * blue[k]
        around += ambient
        ar += ambient * red[k]
        ag += ambient * green[k]
        ab += ambient * blue[k]
    total, around = max(total, TINY), max(around, TINY)
    out[p, 0], out[p, 1], out[p, 2] = r / total, g / total, b / total
    out[p, 3], out[p, 4], out[p, 5] = ar / around, ag / around, ab / around
    out[p, 6] = share / total


@compiled(parallel=True, fastmath=FUSED)
def _light_gradient(normals, index, weight, grad, unoccluded, sphere, parts):
    for block in prange(parts.shape[0]):
        row = np.empty(sphere.shape[1], np.float32)
        for p in range(block * BLOCK, min(normals.shape[0], (block + 1) * BLOCK)):
            _gather(unoccluded, index, weight, p, row)
            _spread(normals[p, 0], normals[p, 1], normals[p, 2], row, sphere, grad[p], parts[block])


@compiled(fastmath=FUSED)
def _spread(nx, ny, nz, row, sphere, grad, part):
    x, y, z, angle = sphere[0], sphere[1], sphere[2], sphere[3]
    total, around = ZERO, ZERO
    for k in range(row.size):
        total += max(nx * x[k] + ny * y[k] + nz * z[k], ZERO) * angle[k]
        around += row[k] * angle[k]
    total, around = max(total, TINY), max(around, TINY)
    for channel in range(3):
        diffuse, ambient = grad[channel] / total, grad[3 + channel] / around
        out = part[channel]
        for k in range(row.size):
            cosine = max(nx * x[k] + ny * y[k] + nz * z[k], ZERO)
            out[k] += row[k] * angle[k] * (cosine * diffuse + ambient)


@compiled(parallel=True, fastmath=FUSED)
def _weights(normals, index, weight, unoccluded, sphere, out):
    for block in prange((normals.shape[0] + BLOCK - 1) // BLOCK):
        row = np.empty(sphere.shape[1], np.float32)
        for p in range(block * BLOCK, min(normals.shape[0], (block + 1) * BLOCK)):
            _gather(unoccluded, index, weight, p, row)
            _averages(normals[p, 0], normals[p, 1], normals[p, 2], row, sphere, out[0, p], out[1, p])


@compiled(fastmath=FUSED)
def _averages(nx, ny, nz, row, sphere, diffuse, ambient):
    x, y, z, angle = sphere[0], sphere[1], sphere[2], sphere[3]
    total, around = ZERO, ZERO
    for k in range(row.size):
        cosine = max(nx * x[k] + ny * y[k] + nz * z[k], ZERO) * angle[k]
        seen = row[k] * angle[k]
        total += cosine
        around += seen
        diffuse[k], ambient[k] = row[k] * cosine, seen
    total, around = 1 / max(total, TINY), 1 / max(around, TINY)
    for k in range(row.size):
        diffuse[k] *= total
        ambient[k] *= around


@compiled(parallel=True, fastmath=FUSED)
def _normal_gradient(normals, index, weight, grad, forward, unoccluded, sphere, out):
    for block in prange((normals.shape[0] + BLOCK - 1) // BLOCK):
        row = np.empty(sphere.shape[1], np.float32)
        for p in range(block * BLOCK, min(normals.shape[0], (block + 1) * BLOCK)):
            _gather(unoccluded, index, weight, p, row)
            _turn(normals[p, 0], normals[p, 1], normals[p, 2], row, sphere, grad[p], forward[p], out[p])


@compiled(fastmath=FUSED)
def _turn(nx, ny, nz, row, sphere, grad, forward, out):
    x, y, z, angle = sphere[0], sphere[1], sphere[2], sphere[3]
    red, green, blue = sphere[4], sphere[5], sphere[6]
    gr, gg, gb, ga = grad[0], grad[1], grad[2], grad[6]
    mean = gr * forward[0] + gg * forward[1] + gb * forward[2] + ga * forward[6]
    total, ox, oy, oz = ZERO, ZERO, ZERO, ZERO
    for k in range(row.size):
        cosine = nx * x[k] + ny * y[k] + nz * z[k]
        facing = angle[k] if cosine > ZERO else ZERO
        pull = facing * (row[k] * (gr * red[k] + gg * green[k] + gb * blue[k] + ga) - mean)
        total += facing * cosine
        ox += pull * x[k]
        oy += pull * y[k]
        oz += pull * z[k]
    total = max(total, TINY)
    out[0], out[1], out[2] = ox / total, oy / total, oz / total

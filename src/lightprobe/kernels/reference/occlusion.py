"""Reference of the occluded light; symbols as in `lightprobe.kernels.occlusion`; slab by slab of pixels."""

from collections.abc import Iterator

import torch
from torch import Tensor

PAIRS_AT_ONCE = 1 << 22  # pixels times directions, for memory
TINY = 1e-12  # keeps a division by nothing finite


def occluded_light(light: Tensor, normals: Tensor, *rest: Tensor) -> Tensor:
    """Return diffuse, ambient and open (P, 7)."""
    out = light.new_zeros(normals.shape[0], 7)
    for part, cosine, ambient, total, around in _slabs(normals, *rest):
        out[part, :3] = cosine @ light / total
        out[part, 3:6] = ambient @ light / around
        out[part, 6:] = cosine.sum(1, keepdim=True) / total
    return out


def light_gradient(grad: Tensor, normals: Tensor, *rest: Tensor) -> Tensor:
    """Return the gradient (K, 3) of the light."""
    out = torch.zeros_like(rest[3])
    for part, cosine, ambient, total, around in _slabs(normals, *rest):
        out += cosine.T @ (grad[part, :3] / total) + ambient.T @ (grad[part, 3:6] / around)
    return out


def normal_gradient(grad: Tensor, out: Tensor, light: Tensor, normals: Tensor, *rest: Tensor) -> Tensor:
    """Return the gradient (P, 3) of the normals, for the forward result `out`."""
    _, _, _, directions, angles = rest
    result = torch.zeros_like(normals)
    for part, _, ambient, total, _ in _slabs(normals, *rest):
        unoccluded = ambient / angles
        g = grad[part]
        mean = (g[:, :3] * out[part, :3]).sum(1, keepdim=True) + g[:, 6:] * out[part, 6:]
        pull = unoccluded * (g[:, :3] @ light.T + g[:, 6:]) - mean
        facing = (normals[part] @ directions.T > 0) * angles
        result[part] = (pull * facing) @ directions / total
    return result


def weights(out: Tensor, normals: Tensor, *rest: Tensor) -> None:
    """Fill `out` (2, P, K) with the weights of diffuse and ambient."""
    for part, cosine, ambient, total, around in _slabs(normals, *rest):
        out[0, part], out[1, part] = cosine / total, ambient / around


def _slabs(
    normals: Tensor, unoccluded: Tensor, index: Tensor, weight: Tensor, directions: Tensor, angles: Tensor
) -> Iterator[tuple[slice, Tensor, Tensor, Tensor, Tensor]]:
    """Yield pixels, c v (p, K), dw v (p, K), sum of c (p, 1) and sum of dw v (p, 1)."""
    step = max(1, PAIRS_AT_ONCE // directions.shape[0])
    for start in range(0, normals.shape[0], step):
        part = slice(start, start + step)
        share = (unoccluded[index[part].long()].to(normals.dtype) * weight[part][..., None]).sum(1) / 255
        cosine = (normals[part] @ directions.T).clamp(min=0) * angles
        ambient = share * angles
        total, around = (sums.sum(1, keepdim=True).clamp(min=TINY) for sums in (cosine, ambient))
        yield part, cosine * share, ambient, total, around

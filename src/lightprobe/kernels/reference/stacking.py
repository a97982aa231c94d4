"""Reference of the stacking; symbols as in `lightprobe.kernels.stacking`; slab by slab of the matrix."""

import math
from collections.abc import Iterator

import torch
from torch import Tensor

PAIRS_AT_ONCE = 1 << 22  # probes times directions, for memory


def stack(
    colors: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """Return sum_p c_p D_p (M, 3) and sum_p D_p (M,)."""
    total, weight = colors.new_zeros(directions.shape[0], 3), colors.new_zeros(directions.shape[0])
    for part, lobe in _slabs(normals, views, alpha2, directions):
        total[part], weight[part] = lobe.T @ colors, lobe.sum(dim=0)
    return total, weight


def stack_backward(
    grad: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor
) -> Tensor:
    """Return sum_w D_p(w) grad(w), shape (N, 3), for `grad` (M, 3) already divided by W."""
    out = grad.new_zeros(normals.shape[0], 3)
    for part, lobe in _slabs(normals, views, alpha2, directions):
        out += lobe @ grad[part]
    return out


def distribution(normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor) -> Tensor:
    """Return D (N, M), the whole matrix."""
    n, a2 = normals[:, None, :], alpha2[:, None]
    half = torch.nn.functional.normalize(directions[None] + views[:, None], dim=2, eps=1e-30)
    cosine2 = (n * half).sum(dim=2) ** 2
    sine2 = torch.linalg.cross(n.expand_as(half), half).square().sum(dim=2)
    bracket = torch.where(half.any(dim=2), sine2 + a2 * cosine2, 1)
    return a2 / (math.pi * bracket**2) * (normals @ directions.T).clamp(min=0)


def _slabs(
    normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor
) -> Iterator[tuple[slice, Tensor]]:
    step = max(1, PAIRS_AT_ONCE // max(1, normals.shape[0]))
    for start in range(0, directions.shape[0], step):
        part = slice(start, start + step)
        yield part, distribution(normals, views, alpha2, directions[part])

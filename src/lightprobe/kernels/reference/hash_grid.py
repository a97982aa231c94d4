"""Reference of the hash grid; symbols as in `lightprobe.kernels.hash_grid`."""

from collections.abc import Iterator

import torch
from torch import Tensor

PRIMES = (1, 2654435761, 805459861)  # of the spatial hash (Teschner et al. 2003; Müller et al. 2022)


def encode(points: Tensor, table: Tensor, cells: list[int]) -> Tensor:
    """Return the features (N, L*F)."""
    levels = []
    for level, resolution in enumerate(cells):
        features = table.new_zeros(points.shape[0], table.shape[2])
        for row, weight in _corners(points, resolution, table.shape[1]):
            features = features + weight[:, None] * table[level, row]
        levels.append(features)
    return torch.cat(levels, dim=1) if levels else table.new_zeros(points.shape[0], 0)


def encode_backward(grad: Tensor, points: Tensor, cells: list[int], table_shape: torch.Size) -> Tensor:
    """Return the gradient (L, T, F) to the table."""
    out = grad.new_zeros(table_shape)
    parts = grad.split(max(table_shape[2], 1), dim=1)
    for level, (resolution, part) in enumerate(zip(cells, parts, strict=True)):
        for row, weight in _corners(points, resolution, table_shape[1]):
            out[level].index_add_(0, row, weight[:, None] * part)
    return out


def encode_backward_to_points(grad: Tensor, points: Tensor, table: Tensor, cells: list[int]) -> Tensor:
    """Return the gradient (N, 3) to the points."""
    with torch.enable_grad():
        moved = points.detach().requires_grad_()
        (out,) = torch.autograd.grad(encode(moved, table.detach(), cells), moved, grad, allow_unused=True)
    return torch.zeros_like(points) if out is None else out


def _corners(points: Tensor, resolution: int, size: int) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield the table row (N,) and trilinear weight (N,) of each of the 8 corners of the points' cells."""
    scaled = points.clamp(0, 1) * resolution
    cell = scaled.floor().clamp(max=resolution - 1).nan_to_num()
    fraction = scaled - cell
    side = resolution + 1
    for corner in range(8):
        offset = torch.tensor([corner & 1, corner >> 1 & 1, corner >> 2], device=points.device)
        x, y, z = (cell.long() + offset).unbind(1)
        weight = torch.where(offset == 1, fraction, 1 - fraction).prod(dim=1)
        if side**3 <= size:
            yield x + side * (y + side * z), weight
        else:
            yield (x * PRIMES[0] ^ y * PRIMES[1] ^ z * PRIMES[2]) & (size - 1), weight

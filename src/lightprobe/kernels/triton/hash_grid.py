"""Triton backend of the hash grid; symbols as in `lightprobe.kernels.hash_grid`.

A program serves a block of points on one level. The table's gradient is summed with integer atomics
(`fixed_point`): points of a batch meet in few rows of the coarse levels, and yet the bits repeat. That of a
point is summed by one program over all levels.
"""

import functools

import torch
import triton
import triton.language as tl
from torch import Tensor

from lightprobe.kernels.triton import fixed_point

POINTS = 256  # of one program


def encode(points: Tensor, table: Tensor, cells: list[int]) -> Tensor:
    """Return the features (N, L*F)."""
    out = table.new_empty(points.shape[0], table.shape[0] * table.shape[2])
    if out.numel():
        with torch.cuda.device_of(points):
            case = points.contiguous(), table.contiguous(), _on_device(tuple(cells), points.device), out
            _encode[_grid(points, cells)](*case, *_sizes(points, table.shape), enable_fp_fusion=True)
    return out


def encode_backward(grad: Tensor, points: Tensor, cells: list[int], table_shape: torch.Size) -> Tensor:
    """Return the gradient (L, T, F) to the table."""
    if grad.numel() == 0:
        return grad.new_zeros(table_shape)
    scale = fixed_point.scale_for(grad.abs().amax(), 8 * points.shape[0])
    sums = torch.zeros(table_shape, dtype=torch.int64, device=grad.device)
    with torch.cuda.device_of(points):
        case = grad.contiguous(), points.contiguous(), _on_device(tuple(cells), points.device), scale, sums
        _encode_backward[_grid(points, cells)](*case, *_sizes(points, table_shape), enable_fp_fusion=True)
    return fixed_point.decode(sums, scale)


def encode_backward_to_points(grad: Tensor, points: Tensor, table: Tensor, cells: list[int]) -> Tensor:
    """Return the gradient (N, 3) to the points."""
    out = torch.zeros_like(points, memory_format=torch.contiguous_format)
    if grad.numel():
        with torch.cuda.device_of(points):
            grid, sizes = _grid(points, cells)[:1], _sizes(points, table.shape)
            case = grad.contiguous(), points.contiguous(), table.contiguous()
            at = _on_device(tuple(cells), points.device)
            _encode_backward_to_points[grid](*case, at, out, *sizes, enable_fp_fusion=True)
    return out


def _grid(points: Tensor, cells: list[int]) -> tuple[int, int]:
    return triton.cdiv(points.shape[0], POINTS), len(cells)


def _sizes(points: Tensor, table_shape: torch.Size) -> tuple[int, int, int, int, int, int]:
    """Return points, levels, rows, features, features up to a power of two, and points of one program."""
    levels, rows, features = table_shape
    return points.shape[0], levels, rows, features, triton.next_power_of_2(features), POINTS


@functools.lru_cache(maxsize=16)
def _on_device(cells: tuple[int, ...], device: torch.device) -> Tensor:
    """Return the resolutions (L,) int32; kept, as no copy to the device may happen within a CUDA graph."""
    return torch.tensor(cells, dtype=torch.int32, device=device)


@triton.jit
def _block(count, features, WIDE: tl.constexpr, POINTS: tl.constexpr):
    """Return a program's points and features, which of the points there are, and which pairs of both."""
    n = tl.program_id(0).to(tl.int64) * POINTS + tl.arange(0, POINTS)
    f = tl.arange(0, WIDE)
    live = n < count
    return n, f, live, live[:, None] & (f < features)[None, :]


@triton.jit
def _axis(points, n, axis, live, resolution):
    """Return the cell of the points along one axis and the position in it."""
    unit = tl.load(points + 3 * n + axis, mask=live, other=0.0)
    scaled = tl.minimum(tl.maximum(unit, 0.0), 1.0) * resolution.to(tl.float32)
    cell = tl.maximum(tl.minimum(scaled.to(tl.int32), resolution - 1), 0)  # whatever integer NaN becomes
    return cell, scaled - cell.to(tl.float32)


@triton.jit
def _cells(points, n, live, resolution):
    """Return the cells of the points and the positions in them, per axis."""
    i, x = _axis(points, n, 0, live, resolution)
    j, y = _axis(points, n, 1, live, resolution)
    k, z = _axis(points, n, 2, live, resolution)
    return i, j, k, x, y, z


@triton.jit
def _corner(i, j, k, x, y, z, CORNER: tl.constexpr, side, rows):
    """Return the table row (int64) of one corner of the cells, and its weight along each axis."""
    a: tl.constexpr = CORNER & 1
    b: tl.constexpr = (CORNER >> 1) & 1
    c: tl.constexpr = CORNER >> 2
    i, j, k = i + a, j + b, k + c
    dense = i.to(tl.int64) + side * (j.to(tl.int64) + side * k.to(tl.int64))
    mixed = i.to(tl.uint32) ^ (j.to(tl.uint32) * 2654435761) ^ (k.to(tl.uint32) * 805459861)
    hashed = mixed.to(tl.int64) & (rows - 1)
    row = tl.where(side * side * side <= rows, dense, hashed)
    weight_x = x if a == 1 else 1 - x
    weight_y = y if b == 1 else 1 - y
    weight_z = z if c == 1 else 1 - z
    return row, weight_x, weight_y, weight_z


@triton.jit
def _encode(
    points, table, cells, out, count, levels, rows, features, WIDE: tl.constexpr, POINTS: tl.constexpr
):
    n, f, live, mask = _block(count, features, WIDE, POINTS)
    level = tl.program_id(1).to(tl.int64)
    resolution = tl.load(cells + level)
    side = resolution.to(tl.int64) + 1
    i, j, k, x, y, z = _cells(points, n, live, resolution)
    total = tl.zeros([POINTS, WIDE], dtype=tl.float32)
    for corner in tl.static_range(8):
        row, weight_x, weight_y, weight_z = _corner(i, j, k, x, y, z, corner, side, rows)
        at = (level * rows + row) * features
        entry = tl.load(table + at[:, None] + f[None, :], mask=mask, other=0.0)
        total += (weight_x * weight_y * weight_z)[:, None] * entry
    tl.store(out + (n * levels + level)[:, None] * features + f[None, :], total, mask=mask)


@triton.jit
def _encode_backward(
    grad, points, cells, scale, sums, count, levels, rows, features, WIDE: tl.constexpr, POINTS: tl.constexpr
):
    n, f, live, mask = _block(count, features, WIDE, POINTS)
    level = tl.program_id(1).to(tl.int64)
    resolution = tl.load(cells + level)
    side = resolution.to(tl.int64) + 1
    i, j, k, x, y, z = _cells(points, n, live, resolution)
    value = tl.load(grad + (n * levels + level)[:, None] * features + f[None, :], mask=mask, other=0.0)
    unit = tl.load(scale)
    for corner in tl.static_range(8):
        row, weight_x, weight_y, weight_z = _corner(i, j, k, x, y, z, corner, side, rows)
        at = (level * rows + row) * features
        weight = weight_x * weight_y * weight_z
        fixed_point.add(sums + at[:, None] + f[None, :], weight[:, None] * value, unit, mask)


@triton.jit
def _slope(points, n, axis, live, total, out):
    """Store the gradient to one coordinate of the points: none where it is clamped."""
    unit = tl.load(points + 3 * n + axis, mask=live, other=-1.0)
    tl.store(out + 3 * n + axis, tl.where((unit >= 0.0) & (unit <= 1.0), total, 0.0), mask=live)


@triton.jit
def _encode_backward_to_points(
    grad, points, table, cells, out, count, levels, rows, features, WIDE: tl.constexpr, POINTS: tl.constexpr
):
    n, f, live, mask = _block(count, features, WIDE, POINTS)
    total_x = tl.zeros([POINTS], dtype=tl.float32)
    total_y = tl.zeros([POINTS], dtype=tl.float32)
    total_z = tl.zeros([POINTS], dtype=tl.float32)
    for level in range(levels):
        resolution = tl.load(cells + level)
        side, scale = resolution.to(tl.int64) + 1, resolution.to(tl.float32)
        i, j, k, x, y, z = _cells(points, n, live, resolution)
        value = tl.load(grad + (n * levels + level)[:, None] * features + f[None, :], mask=mask, other=0.0)
        for corner in tl.static_range(8):
            row, weight_x, weight_y, weight_z = _corner(i, j, k, x, y, z, corner, side, rows)
            at = (tl.cast(level, tl.int64) * rows + row) * features
            entry = tl.load(table + at[:, None] + f[None, :], mask=mask, other=0.0)
            change = scale * tl.sum(value * entry, axis=1)
            total_x += (change if corner & 1 == 1 else -change) * weight_y * weight_z
            total_y += (change if (corner >> 1) & 1 == 1 else -change) * weight_x * weight_z
            total_z += (change if corner >> 2 == 1 else -change) * weight_x * weight_y
    _slope(points, n, 0, live, total_x, out)
    _slope(points, n, 1, live, total_y, out)
    _slope(points, n, 2, live, total_z, out)

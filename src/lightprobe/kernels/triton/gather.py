"""Triton backend of the row gathers; symbols as in `lightprobe.kernels.gather`.

A program serves a block of queries and a block of channels. The scatters add with integer atomics
(`fixed_point`), so they need no sorting and yet repeat to the bit.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

from lightprobe.kernels.triton import fixed_point

ELEMENTS = 1024  # queries x channels of one program
CHANNELS = 64  # at most, in one program


def weighted_gather(values: Tensor, index: Tensor, weight: Tensor) -> Tensor:
    """Return (N, C): sum over k of `weight[n, k] * values[index[n, k]]`."""
    out = values.new_empty(index.shape[0], values.shape[1])
    grid, block = _tiles(*out.shape)
    if out.numel():
        with torch.cuda.device_of(values):
            case = values.contiguous(), index.contiguous(), weight.contiguous(), out
            _gather[grid](*case, *out.shape, index.shape[1], *block, enable_fp_fusion=True)
    return out


def scatter_weighted(grad: Tensor, index: Tensor, weight: Tensor, rows: int) -> Tensor:
    """Return the gradient (rows, C) to `values`."""
    return _scattered(grad, index, weight.contiguous(), rows)


def row_products(grad: Tensor, index: Tensor, values: Tensor) -> Tensor:
    """Return the gradient (N, K) to `weight`."""
    out = grad.new_empty(index.shape)
    queries, channels = index.numel(), values.shape[1]
    grid, block = _tiles(queries, channels)
    if out.numel():
        with torch.cuda.device_of(grad):
            case = grad.contiguous(), index.contiguous(), values.contiguous(), out
            sizes = queries, channels, index.shape[1], *block
            _row_products[grid[:1]](*case, *sizes, enable_fp_fusion=True)
    return out


def scatter_rows(grad: Tensor, index: Tensor, rows: int) -> Tensor:
    """Return (rows, C): `grad` (N, C) summed into the rows named by `index` (N,)."""
    return _scattered(grad, index[:, None], None, rows)


def _scattered(grad: Tensor, index: Tensor, weight: Tensor | None, rows: int) -> Tensor:
    """Return the rows that sum `weight * grad`, or `grad` where there is no weight."""
    if grad.numel() == 0 or index.numel() == 0:
        return grad.new_zeros(rows, grad.shape[1])
    magnitude = grad.abs().amax() * (1 if weight is None else weight.abs().amax())
    scale = fixed_point.scale_for(magnitude, index.numel())
    sums = torch.zeros(rows, grad.shape[1], dtype=torch.int64, device=grad.device)
    grid, block = _tiles(*grad.shape)
    factor = scale if weight is None else weight  # never read when there is no weight
    with torch.cuda.device_of(grad):
        case = grad.contiguous(), index.contiguous(), factor, scale, sums
        sizes = *grad.shape, index.shape[1], weight is not None, *block
        _scatter[grid](*case, *sizes, enable_fp_fusion=True)
    return fixed_point.decode(sums, scale)


def _tiles(queries: int, channels: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the grid and the block (queries, channels) of one program."""
    wide = min(CHANNELS, triton.next_power_of_2(max(channels, 1)))
    tall = ELEMENTS // wide
    return (triton.cdiv(queries, tall), triton.cdiv(channels, wide)), (tall, wide)


@triton.jit
def _gather(values, index, weight, out, queries, channels, taps, TALL: tl.constexpr, WIDE: tl.constexpr):
    n = tl.program_id(0).to(tl.int64) * TALL + tl.arange(0, TALL)
    c = tl.program_id(1) * WIDE + tl.arange(0, WIDE)
    live = n < queries
    mask = live[:, None] & (c < channels)[None, :]
    total = tl.zeros([TALL, WIDE], dtype=tl.float32)
    for k in range(taps):
        row = tl.load(index + n * taps + k, mask=live, other=0).to(tl.int64)
        factor = tl.load(weight + n * taps + k, mask=live, other=0.0)
        entry = tl.load(values + row[:, None] * channels + c[None, :], mask=mask, other=0.0)
        total += factor[:, None] * entry
    tl.store(out + n[:, None] * channels + c[None, :], total, mask=mask)


@triton.jit
def _scatter(
    grad,
    index,
    weight,
    scale,
    sums,
    queries,
    channels,
    taps,
    WEIGHTED: tl.constexpr,
    TALL: tl.constexpr,
    WIDE: tl.constexpr,
):
    n = tl.program_id(0).to(tl.int64) * TALL + tl.arange(0, TALL)
    c = tl.program_id(1) * WIDE + tl.arange(0, WIDE)
    live = n < queries
    mask = live[:, None] & (c < channels)[None, :]
    value = tl.load(grad + n[:, None] * channels + c[None, :], mask=mask, other=0.0)
    unit = tl.load(scale)
    for k in range(taps):
        row = tl.load(index + n * taps + k, mask=live, other=0).to(tl.int64)
        part = value
        if WEIGHTED:
            part = value * tl.load(weight + n * taps + k, mask=live, other=0.0)[:, None]
        fixed_point.add(sums + row[:, None] * channels + c[None, :], part, unit, mask)


@triton.jit
def _row_products(grad, index, values, out, queries, channels, taps, TALL: tl.constexpr, WIDE: tl.constexpr):
    """One row per (query, tap)."""
    pair = tl.program_id(0).to(tl.int64) * TALL + tl.arange(0, TALL)
    live = pair < queries
    n = pair // taps
    row = tl.load(index + pair, mask=live, other=0).to(tl.int64)
    total = tl.zeros([TALL, WIDE], dtype=tl.float32)
    for first in range(0, channels, WIDE):
        c = first + tl.arange(0, WIDE)
        mask = live[:, None] & (c < channels)[None, :]
        left = tl.load(grad + n[:, None] * channels + c[None, :], mask=mask, other=0.0)
        total += left * tl.load(values + row[:, None] * channels + c[None, :], mask=mask, other=0.0)
    tl.store(out + pair, tl.sum(total, axis=1), mask=live)

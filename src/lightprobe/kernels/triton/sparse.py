"""Triton backend of the sparse product; symbols as in `lightprobe.kernels.sparse`.

A program serves a row, its entries in blocks of one size, so that the order of the sums is fixed. Only whole
products are asked of a GPU: there the transpose is a matrix of its own.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

from lightprobe.kernels.sparse import CompressedRows

_NARROWEST, _WIDEST = 32, 1024  # entries of a block
_PER_WARP = 128  # entries, so that each lane waits for four at a time


def product(matrix: CompressedRows, x: Tensor, rows: None) -> Tensor:
    """Return the product (M, 3), float32."""
    count = matrix.start.numel() - 1
    out = x.new_empty(count, 3, dtype=torch.float32)
    if count:
        wide = min(_WIDEST, max(_NARROWEST, triton.next_power_of_2(triton.cdiv(matrix.value.numel(), count))))
        with torch.cuda.device_of(x):
            case = matrix.start, matrix.column, matrix.value, x.float().contiguous(), out
            _multiply[(count,)](*case, wide, num_warps=max(1, wide // _PER_WARP), enable_fp_fusion=True)
    return out


@triton.jit
def _multiply(start, column, value, x, out, WIDE: tl.constexpr):
    row = tl.program_id(0)
    first, end = tl.load(start + row), tl.load(start + row + 1)
    lane = tl.arange(0, WIDE)
    red = tl.zeros([WIDE], dtype=tl.float32)
    green, blue = red, red
    for block in range(first, end, WIDE):
        live = block + lane < end
        weight = tl.load(value + block + lane, mask=live, other=0.0)
        texel = 3 * tl.load(column + block + lane, mask=live, other=0).to(tl.int64)
        red += weight * tl.load(x + texel, mask=live, other=0.0)
        green += weight * tl.load(x + texel + 1, mask=live, other=0.0)
        blue += weight * tl.load(x + texel + 2, mask=live, other=0.0)
    tl.store(out + 3 * row, tl.sum(red))
    tl.store(out + 3 * row + 1, tl.sum(green))
    tl.store(out + 3 * row + 2, tl.sum(blue))

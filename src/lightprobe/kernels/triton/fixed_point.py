"""Sums by atomic addition that do not depend on the order: 64-bit integers count multiples of a power of two.

With at most n terms of magnitude up to m, the unit 2^-e is the finest for which no sum can overflow: n m 2^e
< 2^62. For 2^20 terms each is then held to 2^-42 m, much finer than float32 holds a sum of them.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

_BITS = 61  # one below 2^62, for the rounding of log2
_MOST = 120  # keeps scale and 1 / scale normal in float32


def scale_for(magnitude: Tensor, terms: int) -> Tensor:
    """Return the float32 factor 2^e (1,) for sums of up to `terms` values up to `magnitude` (); NaN stays."""
    exponent = torch.floor(_BITS - torch.log2(magnitude * max(terms, 1)))
    return torch.exp2(exponent.clamp(-_MOST, _MOST)).reshape(1)


def decode(sums: Tensor, scale: Tensor) -> Tensor:
    """Return the float32 values of integer `sums` (any shape)."""
    return (sums.double() / scale).float()


@triton.jit
def add(pointer, value, scale, mask):
    """Add float32 `value` times `scale` to the int64 behind `pointer`."""
    tl.atomic_add(pointer, (value * scale).to(tl.int64), mask=mask, sem="relaxed")

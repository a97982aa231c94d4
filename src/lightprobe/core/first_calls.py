"""PyTorch's vector functions are called once on one thread, so that they compute the same from then on.

PyTorch hands square roots, exponentials and their like on the CPU to Intel's vector mathematics, which looks
for the fitting code of each function when it is first called. Two threads that call at the same time can meet
it half chosen: one of them then computes its half with 12 bits instead of 24, in this one call (oneMKL
2024.2, PyTorch issue 188792). Without this, 3 of 16 processes began so, and no two trainings need have had
the same bits.

Importing this module is enough; the lowest packages that compute do.
"""

import torch

_FUNCTIONS = "acos asin atan cos cosh erf erfc erfinv exp expm1 log log10 log1p log2 sin sinh sqrt tan tanh"

for _precision in (torch.float32, torch.float64):
    for _name in _FUNCTIONS.split():
        getattr(torch, _name)(torch.full((1,), 0.5, dtype=_precision))

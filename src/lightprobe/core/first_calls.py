"""A process computes the same from its first call on: PyTorch's vector functions are called once, on one
thread.

PyTorch hands square roots, exponentials and their like on the CPU to Intel's vector mathematics, which looks
for the fitting code of each function when it is first called. Two threads that call at the same time can meet
it half chosen: one of them then computes its half with 12 bits instead of 24, in this one call (oneMKL
2024.2, PyTorch issue 188792). Without this, 3 of 16 processes began so, and no two trainings need have had
the same bits.

Importing this module is enough; the lowest packages that compute do.
"""

import torch

_VECTOR_FUNCTIONS = (
    torch.acos,
    torch.asin,
    torch.atan,
    torch.cos,
    torch.cosh,
    torch.erf,
    torch.erfc,
    torch.erfinv,
    torch.exp,
    torch.expm1,
    torch.log,
    torch.log10,
    torch.log1p,
    torch.log2,
    torch.sin,
    torch.sinh,
    torch.sqrt,
    torch.tan,
    torch.tanh,
)


def _call_once() -> None:
    for precision in (torch.float32, torch.float64):
        value = torch.full((1,), 0.5, dtype=precision)
        for function in _VECTOR_FUNCTIONS:
            function(value)


_call_once()

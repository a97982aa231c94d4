"""One way to compile a loop: cached on disk, parallel, on as many threads as PyTorch uses."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor

STEPS_PER_THREAD = 50_000  # of a loop; with fewer, starting a thread costs more than it saves


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return `numba.njit` with a disk cache, or without one where no folder can be written.

    `error_model="numpy"`: a division by zero gives infinity as in the reference, and does not stop
    vectorisation.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        try:
            return numba.njit(cache=True, error_model="numpy", **options)(function)
        except RuntimeError:  # neither the package's folder nor the user's cache folder is writable
            return numba.njit(error_model="numpy", **options)(function)

    return decorate


def threads(work: int) -> int:
    """Set Numba's thread count for a loop of `work` steps (about a nanosecond each) and return it.

    At most as many as PyTorch uses, so that `torch.set_num_threads` governs both pools; one for small work,
    because on a busy machine even an idle thread costs a wait for its turn. Loops that need the count take it
    as an argument: one that asks Numba for it cannot be cached on disk.
    """
    allowed = torch.get_num_threads()
    count = min(allowed, int(numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
    count = max(1, min(count, work // STEPS_PER_THREAD))
    numba.set_num_threads(count)
    if torch.get_num_threads() != allowed:  # starting its pool, Numba gives OpenMP all cores, PyTorch with it
        torch.set_num_threads(allowed)
    return count


def arrays(*tensors: Tensor) -> list[np.ndarray]:
    """Return contiguous views of tensors of any shape, integers as int32; copies where needed.

    One type and layout mean one compilation.
    """
    return [
        (tensor.detach() if tensor.is_floating_point() else tensor.to(torch.int32)).contiguous().numpy()
        for tensor in tensors
    ]

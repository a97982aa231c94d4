"""The backends that a kernel's tests run through."""

import os
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from torch import Tensor

from lightprobe.kernels import dispatch


@dataclass(frozen=True)
class Backend:
    """A backend under test: where its tensors live, and whether it is so slow that cases must be small."""

    device: torch.device
    interpreted: bool = False

    def size(self, usual: int, interpreted: int) -> int:
        return interpreted if self.interpreted else usual

    def move(self, *tensors: Tensor) -> list[Tensor]:
        return [tensor.to(self.device) for tensor in tensors]


@pytest.fixture(
    params=[
        "numba",
        pytest.param("triton", marks=pytest.mark.slow),  # through the interpreter
        pytest.param("cuda", marks=pytest.mark.cuda),
    ]
)
def backend(request, monkeypatch):
    """Numba's backend, Triton's in its interpreter, and whatever serves a GPU where there is one."""
    if request.param == "numba":
        yield Backend(torch.device("cpu"))
        return
    pytest.importorskip("triton")
    if request.param == "cuda":
        if not torch.cuda.is_available():
            pytest.skip("no CUDA device")
        yield Backend(torch.device("cuda"))
        return
    if os.environ.get("TRITON_INTERPRET") != "1":
        pytest.skip("Triton runs on the device")
    monkeypatch.setattr(dispatch, "backend_for", lambda device: dispatch.Backend.TRITON)
    with np.errstate(all="ignore"):  # lanes that are masked out may divide by zero, as on a GPU
        yield Backend(torch.device("cpu"), interpreted=True)

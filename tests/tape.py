"""A stand-in for CUDA graphs on a CPU: every operator of a call is written down with its tensors, and made
again.

As on a GPU, what Python decided while the call was recorded stays decided, results land where they did then,
and the host must not look at them in between. Copies from the host show only as new tensors, and memory is
not freed.
"""

from collections.abc import Callable
from types import ModuleType

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from lightprobe.kernels import dispatch
from lightprobe.light import cubemap
from lightprobe.render import taps, transport
from lightprobe.training.recording import Call

# what reads values on the host, or brings them from there
HOST = {
    "_local_scalar_dense",
    "nonzero",
    "lift_fresh",
    "equal",
    "masked_select",
    "_unique2",
    "repeat_interleave",
}
INDEXED = {"index", "index_put", "index_put_"}  # so does a mask


def compute_as_a_gpu_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all computation be operators of PyTorch, without the looks at values that only a CPU takes."""
    monkeypatch.setattr(dispatch, "backend_for", lambda device: dispatch.Backend.REFERENCE)
    monkeypatch.setattr(dispatch, "require_index", lambda *_: None)
    monkeypatch.setattr(cubemap, "_on_cpu", lambda tensor: False)
    monkeypatch.setattr(transport, "look_up", lambda *given, often: taps.GatheredTaps(*given))


class _Tape(TorchDispatchMode):
    def __init__(self) -> None:
        super().__init__()
        self.operators: list[tuple] = []

    def __torch_dispatch__(self, operator, types, args=(), kwargs=None):
        name = operator._schema.name.split("::")[1]
        masked = name in INDEXED and any(
            x is not None and x.dtype in (torch.bool, torch.uint8) for x in args[1]
        )
        if name in HOST or masked:
            raise RuntimeError(f"{name} in a recorded step")
        out = operator(*args, **(kwargs or {}))
        self.operators.append((operator, args, kwargs or {}, out))
        return out


class TapeRecorder:
    """Records on the CPU."""

    def __init__(self) -> None:
        self.recordings = self.replays = 0

    def warm_up(self, call: Call) -> Tensor:
        return call()

    def record(self, call: Call) -> tuple[Tensor, Callable[[], None]]:
        self.recordings += 1
        with _Tape() as tape:
            result = call()  # a GPU computes nothing yet: the first replay is this one
        computed = True

        def replay() -> None:
            nonlocal computed
            self.replays += 1
            if not computed:
                _again(tape.operators)
            computed = False

        return result, replay


def record_on_tape(monkeypatch: pytest.MonkeyPatch, module: ModuleType) -> list[TapeRecorder]:
    """Let `module` record its steps; return the recorders, to which every new one will be added."""
    recorders: list[TapeRecorder] = []

    def recorder_for(device: torch.device) -> TapeRecorder:
        recorders.append(TapeRecorder())
        return recorders[-1]

    monkeypatch.setattr(module, "recorder_for", recorder_for)
    return recorders


@torch.no_grad()
def _again(operators: list[tuple]) -> None:
    for operator, args, kwargs, before in operators:
        after = operator(*args, **kwargs)
        for place, value in zip(tree_leaves(before), tree_leaves(after), strict=True):
            if isinstance(place, Tensor) and place.data_ptr() != value.data_ptr():
                place.copy_(value)

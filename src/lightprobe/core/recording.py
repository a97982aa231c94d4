"""Steps recorded on a GPU and replayed: CUDA graphs.

A step of descent on small tensors is a hundred kernels that keep a GPU busy for less time than the CPU needs to ask for
them one by one. Recorded, they are asked for at once.
"""

import gc
import warnings
from collections.abc import Callable
from typing import Protocol

import torch
from torch import Tensor

_WARM_UP = 3  # steps before the recording, in which kernels are compiled and tables made

Call = Callable[[], Tensor]


class Recorder(Protocol):
    """What records on a device."""

    def warm_up(self, call: Call) -> Tensor:
        """Make the call in the way that a recording of it will need, and return its result."""

    def record(self, call: Call) -> tuple[Tensor, Callable[[], None]]:
        """Return where the result of the call will be and what fills it; nothing is computed yet."""


class Recorded:
    """A step that is made as it is on a CPU, and from a recording on a GPU.

    The step takes tensors and returns its loss (), which is no part of a gradient any more. What changes from one call
    to the next it finds in those tensors or in others that are changed in place, never in Python's numbers; and it
    copies nothing from or to the CPU.
    """

    def __init__(self, step: Callable[..., Tensor], recorder: Recorder | None):
        """Make `step` recordable; without a recorder it is called every time."""
        self._step, self._recorder = step, recorder
        self._calls = 0
        self._inputs: tuple[Tensor, ...] = ()  # where the recording reads
        self._loss: Tensor | None = None  # where it writes
        self._replay: Callable[[], None] | None = None

    def __call__(self, *inputs: Tensor) -> Tensor:
        """Make the step and return its loss."""
        if self._recorder is None:
            return self._step(*inputs)
        self._calls += 1
        if self._calls <= _WARM_UP:
            return self._recorder.warm_up(lambda: self._step(*inputs)).clone()
        if self._replay is None:
            self._record(self._recorder, inputs)
        if self._replay is None or self._loss is None or not _alike(inputs, self._inputs):
            return self._step(*inputs)
        for place, value in zip(self._inputs, inputs, strict=True):
            place.copy_(value)
        self._replay()
        return self._loss.clone()

    def _record(self, recorder: Recorder, inputs: tuple[Tensor, ...]) -> None:
        self._inputs = tuple(value.clone() for value in inputs)
        try:
            self._loss, self._replay = recorder.record(lambda: self._step(*self._inputs))
        except RuntimeError as error:
            warnings.warn(f"Steps cannot be recorded on this device and will be slower: {error}", stacklevel=2)
            self._recorder = None


class CudaRecorder:
    """Recordings as CUDA graphs."""

    def warm_up(self, call: Call) -> Tensor:
        """Make the call on a stream of its own."""
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            result = call()
        torch.cuda.current_stream().wait_stream(stream)
        return result

    def record(self, call: Call) -> tuple[Tensor, Callable[[], None]]:
        """Return the place of the call's result and the replay of its graph.

        `torch.cuda.graph` would collect garbage first, which can take longer than a prediction may. Here it is only
        kept from happening meanwhile, as freeing another graph would spoil this one.
        """
        graph, collects = torch.cuda.CUDAGraph(), gc.isenabled()
        torch.cuda.synchronize()
        gc.disable()
        try:
            with torch.cuda.stream(torch.cuda.Stream()):
                graph.capture_begin()
                try:
                    result = call()
                finally:
                    graph.capture_end()
        finally:
            if collects:
                gc.enable()
        return result, graph.replay


def recorder_for(device: torch.device) -> Recorder | None:
    """Return what records on a device; None where nothing is gained by it."""
    return CudaRecorder() if device.type == "cuda" else None


def _alike(inputs: tuple[Tensor, ...], places: tuple[Tensor, ...]) -> bool:
    return [(value.shape, value.dtype) for value in inputs] == [(place.shape, place.dtype) for place in places]

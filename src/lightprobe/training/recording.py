"""Steps recorded on a GPU and replayed: CUDA graphs.

A step of descent on small tensors is a hundred kernels that keep a GPU busy for less time than the CPU needs
to ask for them one by one. Recorded, they are asked for at once.
"""

import contextlib
import functools
import warnings
from collections import Counter
from collections.abc import Callable

import torch
from torch import Tensor

from lightprobe.core.errors import LightprobeWarning

_WARM_UP = 3  # steps on tensors of the same shapes before the recording: kernels are compiled and tables made
_refused: list[object] = []  # recordings that failed; what is left of them must stay

Call = Callable[[], Tensor]
Shapes = tuple[tuple[torch.Size, torch.dtype], ...]


class RecordedStep:
    """A step that is made as it is on a CPU, and from a recording on a GPU.

    The step takes tensors and returns its loss () without a gradient. What changes between calls it finds in
    those tensors or in others that are changed in place, never in Python's numbers; and it copies nothing
    from or to the CPU. The first shapes that come up often are recorded; others are stepped singly.
    """

    def __init__(self, step: Callable[..., Tensor], recorder: "CudaRecorder | None"):
        """Make `step` recordable; without a recorder it is called every time."""
        self._step, self._recorder = step, recorder
        self._seen: Counter[Shapes] = Counter()
        self._inputs: tuple[Tensor, ...] = ()  # where the recording reads
        self._loss: Tensor | None = None  # where it writes
        self._replay: Callable[[], None] | None = None

    def __call__(self, *inputs: Tensor) -> Tensor:
        """Make the step and return its loss."""
        if self._recorder is None:
            return self._step(*inputs)
        shapes = _shapes(inputs)
        if self._replay is None:
            self._seen[shapes] += 1
            if self._seen[shapes] <= _WARM_UP:
                return self._recorder.warm_up(lambda: self._step(*inputs)).clone()
            self._record(self._recorder, inputs)
        if self._replay is None or self._loss is None or shapes != _shapes(self._inputs):
            return self._step(*inputs)
        for place, value in zip(self._inputs, inputs, strict=True):
            place.copy_(value)
        self._replay()
        return self._loss.clone()

    def _record(self, recorder: "CudaRecorder", inputs: tuple[Tensor, ...]) -> None:
        self._inputs = tuple(value.clone() for value in inputs)
        try:
            self._loss, self._replay = recorder.record(lambda: self._step(*self._inputs))
        except RuntimeError as error:
            reason = error.__context__ or error  # ending a failed recording fails in turn
            sentence = f"Steps cannot be recorded on this device and will be slower: {reason}"
            warnings.warn(sentence, LightprobeWarning, stacklevel=2)
            self._recorder, self._inputs = None, ()


class CudaRecorder:
    """Recordings as CUDA graphs, all on one stream, as memory that was used on a stream stays with it.

    A test's recorder on the CPU has the same two methods.
    """

    def __init__(self, device: torch.device):
        """Record on `device`, whether or not it is the current one."""
        self._device, self._stream = device, torch.cuda.Stream(device)

    def warm_up(self, call: Call) -> Tensor:
        """Make the call on the stream of the recordings, and return its result ()."""
        with torch.cuda.device(self._device), warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="This instance was constructed with capturable=True")
            current = torch.cuda.current_stream()
            self._stream.wait_stream(current)
            with torch.cuda.stream(self._stream):
                result = call()
            current.wait_stream(self._stream)
        return result

    def record(self, call: Call) -> tuple[Tensor, Callable[[], None]]:
        """Return the place of the call's result () and what fills it; nothing is computed yet.

        Raises `RuntimeError` when the call cannot be recorded. Ending a broken capture fails in turn, before
        PyTorch has left its stream and told its allocator; both are made good here, so that a caller that
        catches the error can go on.
        """
        graph, pool = torch.cuda.CUDAGraph(), torch.cuda.graph_pool_handle()
        try:
            with (
                torch.cuda.device(self._device),
                torch.cuda.stream(self._stream),
                torch.cuda.graph(graph, pool=pool, stream=self._stream),
            ):
                result = call()
        except RuntimeError:
            _refused.append(graph)
            with torch.cuda.device(self._device), contextlib.suppress(RuntimeError):  # it may have ended
                torch._C._cuda_endAllocateToPool(torch.cuda.current_device(), pool)
                torch._C._cuda_releasePool(torch.cuda.current_device(), pool)
            graph.reset()
            raise
        return result, graph.replay


def recorder_for(device: torch.device) -> CudaRecorder | None:
    """Return what records on a device; None where nothing is gained by it, or where it has failed before."""
    return _cuda_recorder(device) if device.type == "cuda" and not _refused else None


@functools.cache
def _cuda_recorder(device: torch.device) -> CudaRecorder:
    return CudaRecorder(device)


def _shapes(tensors: tuple[Tensor, ...]) -> Shapes:
    return tuple((tensor.shape, tensor.dtype) for tensor in tensors)

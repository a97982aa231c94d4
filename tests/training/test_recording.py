from contextlib import contextmanager

import pytest
import torch

from lightprobe.training import recording
from lightprobe.training.recording import CudaRecorder, RecordedStep, recorder_for
from tests.tape import TapeRecorder


class Counter:
    """A step with a memory of its own: returns the sum of what it was given so far."""

    def __init__(self):
        self.total = torch.zeros(())
        self.calls = 0

    def step(self, x):
        self.calls += 1
        self.total += x.sum()
        return self.total.clone()


def test_without_a_recorder_every_call_is_the_step_itself():
    counter = Counter()
    recorded = RecordedStep(counter.step, recorder_for(torch.device("cpu")))
    assert [float(recorded(torch.ones(2))) for _ in range(6)] == [2, 4, 6, 8, 10, 12]
    assert counter.calls == 6


def test_a_recording_reads_new_inputs_and_keeps_the_steps_memory():
    counter, recorder = Counter(), TapeRecorder()
    recorded = RecordedStep(counter.step, recorder)
    found = [recorded(torch.full((2,), float(k))) for k in range(8)]
    assert [float(value) for value in found] == [k * (k + 1) for k in range(8)]  # each result kept
    assert (recorder.recordings, recorder.replays, counter.calls) == (1, 5, 4)


def test_other_shapes_are_stepped_without_the_recording():
    counter, recorder = Counter(), TapeRecorder()
    recorded = RecordedStep(counter.step, recorder)
    for _ in range(5):
        recorded(torch.ones(2))
    assert float(recorded(torch.ones(3))) == 13
    assert float(recorded(torch.ones(2))) == 15
    assert (recorder.recordings, recorder.replays) == (1, 3)


@pytest.mark.parametrize("look", [lambda x: x[x > 0].sum(), lambda x: x.sum() * torch.equal(x, x)])
def test_the_stand_in_refuses_what_a_graph_would(look):
    with pytest.raises(RuntimeError, match="in a recorded step"):
        TapeRecorder().record(lambda: look(torch.ones(3)))


def test_what_cannot_be_recorded_is_stepped_with_a_warning():
    def reads(x):
        total.add_(x.sum())
        return x * float(x.sum())

    total, recorder = torch.zeros(()), TapeRecorder()
    recorded = RecordedStep(reads, recorder)
    for _ in range(3):
        recorded(torch.ones(2))
    with pytest.warns(UserWarning, match="cannot be recorded"):
        assert recorded(torch.ones(2)).tolist() == [2, 2]
    assert recorded(torch.ones(2)).tolist() == [2, 2]
    assert recorder.recordings == 1


class BrokenGraphs:
    """Stands in for `torch.cuda` where a capture breaks: ending it fails, and leaves stream and allocator
    behind.
    """

    def __init__(self, monkeypatch):
        self.streams, self.pools, self.released, self.graphs = ["its own"], [], [], []
        for name in ("device", "stream", "graph"):
            monkeypatch.setattr(torch.cuda, name, getattr(self, name))
        monkeypatch.setattr(torch.cuda, "Stream", lambda device: "recordings'")
        monkeypatch.setattr(torch.cuda, "CUDAGraph", lambda: self)
        monkeypatch.setattr(torch.cuda, "graph_pool_handle", lambda: (0, 7))
        monkeypatch.setattr(torch.cuda, "current_device", lambda: 1)
        private = {"_cuda_endAllocateToPool": self.pools.remove, "_cuda_releasePool": self.released.append}
        for name, note in private.items():
            monkeypatch.setattr(torch._C, name, lambda *where, note=note: note(where), raising=False)
        monkeypatch.setattr(recording, "_refused", self.graphs)

    @contextmanager
    def device(self, device):
        yield

    @contextmanager
    def stream(self, stream):
        before = self.streams[-1]
        self.streams.append(stream)
        try:
            yield
        finally:
            self.streams.append(before)

    @contextmanager
    def graph(self, graph, pool=None, stream=None):
        self.streams.append(stream)
        self.pools.append((1, pool))
        try:
            yield
        finally:
            raise RuntimeError("operation failed due to a previous error during capture")

    def reset(self):
        assert not self.pools, "the allocator asks the graph which memory is its own"
        self.streams.append(self.streams[-1])


def test_a_broken_recording_leaves_stream_and_allocator_as_they_were(monkeypatch):
    cuda = BrokenGraphs(monkeypatch)
    with pytest.raises(RuntimeError, match="previous error"):
        CudaRecorder(torch.device("cuda", 1)).record(lambda: torch.ones(()))
    assert cuda.streams[-1] == "its own"
    assert (cuda.pools, cuda.released) == ([], [(1, (0, 7))])
    assert cuda.graphs == [cuda]
    assert recorder_for(torch.device("cuda", 1)) is None


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_after_a_broken_recording_a_gpu_goes_on(monkeypatch):
    monkeypatch.setattr(recording, "_refused", [])
    device, before = torch.device("cuda", torch.cuda.current_device()), torch.cuda.current_stream()
    values = torch.rand(1000, device=device)
    recorded = RecordedStep(lambda x: x.sum() * float(x.sum() > 0), CudaRecorder(device))
    with pytest.warns(UserWarning, match="cannot be recorded"):
        found = [float(recorded(values)) for _ in range(6)]
    assert found == [float(values.sum())] * 6
    assert torch.cuda.current_stream() == before
    again = CudaRecorder(device)
    again.warm_up(lambda: values.sum())
    result, replay = again.record(lambda: values.sum())
    replay()
    assert float(result) == found[0]

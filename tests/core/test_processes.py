"""What processes of one training compute, exchange and are given, without starting any."""

import pytest
import torch

from lightprobe.core import processes
from lightprobe.core.errors import ConfigError
from lightprobe.core.processes import ALONE, Processes, joined
from tests.shared_training import in_processes


@pytest.mark.parametrize(("length", "count"), [(8, 2), (7, 3), (2, 3), (0, 2)])
def test_parts_are_all_that_there_is_once(length, count):
    parts = [list(range(length))[Processes(rank, count).part(length)] for rank in range(count)]
    assert [thing for part in parts for thing in part] == list(range(length))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_one_process_exchanges_nothing():
    with joined("cpu") as own:
        assert (own, own.alone, own.first) == (ALONE, True, True)
    assert torch.equal(ALONE.average(torch.tensor([1.0, 2.0])), torch.tensor([1.0, 2.0]))
    assert ALONE.agree(3)
    assert ALONE.first_then_others(lambda: 5) == 5


def test_a_loss_of_all_parts_has_the_gradient_of_the_whole():
    x = torch.arange(5.0, dtype=torch.float64, requires_grad=True)
    (x.square().sum() ** 2).backward()

    def work(own):
        y = x.detach().clone().requires_grad_()
        loss = own.sum(y[own.part(5)].square().sum()) ** 2
        loss.backward()
        return own.average(torch.cat([y.grad, loss.detach().reshape(1)]))

    for found in in_processes(2, work):
        torch.testing.assert_close(found[:5], x.grad)
        assert float(found[5]) == 900


def test_the_first_one_works_before_the_others():
    order = []
    in_processes(3, lambda own: own.first_then_others(lambda: order.append(own.rank)))
    assert order[0] == 0
    assert sorted(order) == [0, 1, 2]


def test_processes_know_whether_they_agree():
    assert in_processes(2, lambda own: own.agree(7)) == [True, True]
    assert in_processes(2, lambda own: own.agree(own.rank)) == [False, False]


@pytest.fixture
def two_started(monkeypatch):
    """Stand for torchrun's second process on a machine."""
    for name, value in {"RANK": 1, "LOCAL_RANK": 1, "LOCAL_WORLD_SIZE": 2, "WORLD_SIZE": 2}.items():
        monkeypatch.setenv(name, str(value))
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "test")


@pytest.fixture
def gpus(monkeypatch):
    """Let PyTorch see as many GPUs as the list holds things."""
    seen = [0, 0]
    monkeypatch.setattr(torch.cuda, "is_available", lambda: bool(seen))
    monkeypatch.setattr(torch.cuda, "device_count", lambda: len(seen))
    return seen


@pytest.mark.parametrize("name", ["auto", "cuda"])
@pytest.mark.usefixtures("two_started", "gpus")
def test_each_process_has_a_gpu_of_its_own(name):
    assert processes._own_device(name) == torch.device("cuda", 1)
    assert processes._own_device("cpu") == torch.device("cpu")


@pytest.mark.usefixtures("two_started")
@pytest.mark.parametrize(
    ("name", "words"),
    [("auto", "1 CUDA device"), ("cuda", "1 CUDA device"), ("cuda:0", "is one GPU"), ("x", "Unknown")],
)
def test_devices_that_not_all_can_have_are_refused(gpus, name, words):
    gpus.pop()
    with pytest.raises(ConfigError, match=words), joined(name):
        pass

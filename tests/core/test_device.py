"""Devices by name, with CUDA played by stand-ins."""

import pytest
import torch

from lightprobe.core.device import full_precision, resolve_device
from lightprobe.core.errors import ConfigError


def rounding() -> list[object]:
    """What PyTorch rounds float32 factors to in convolutions and products on a GPU, by all its names."""
    backends = torch.backends
    return [
        backends.cudnn.conv.fp32_precision,
        backends.cudnn.rnn.fp32_precision,
        backends.cuda.matmul.fp32_precision,
        backends.cudnn.allow_tf32,
        backends.cuda.matmul.allow_tf32,
    ]


@pytest.fixture
def rounded_products():
    """Let a GPU round to TF32; all settings are as they were afterwards."""
    before = rounding()
    torch.backends.cudnn.allow_tf32 = torch.backends.cuda.matmul.allow_tf32 = True
    yield
    torch.backends.cudnn.allow_tf32, torch.backends.cuda.matmul.allow_tf32 = before[3:]
    torch.backends.cudnn.fp32_precision = "none"
    torch.backends.cudnn.conv.fp32_precision, torch.backends.cudnn.rnn.fp32_precision = before[:2]


@pytest.fixture
def two_gpus(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "current_device", lambda: 0)


@pytest.mark.parametrize(
    ("name", "device"),
    [("auto", "cuda:0"), ("cuda", "cuda:0"), ("cuda:1", "cuda:1"), ("cpu", "cpu"), ("cpu:0", "cpu")],
)
def test_a_gpu_is_always_named_with_its_number(two_gpus, name, device):
    assert resolve_device(name) == torch.device(device)


@pytest.mark.parametrize("name", ["cuda:2", "mps", "meta", "tpu", "xpu"])
def test_what_cannot_compute_is_refused(two_gpus, name):
    with pytest.raises(ConfigError, match=name):
        resolve_device(name)


def test_without_a_gpu(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert resolve_device("auto") == torch.device("cpu")
    with pytest.raises(ConfigError, match="no CUDA device"):
        resolve_device("cuda")


@pytest.mark.parametrize(
    "take", [lambda: resolve_device("cuda"), lambda: full_precision(torch.device("cuda", 1))]
)
def test_a_gpu_keeps_the_bits_of_its_factors(two_gpus, rounded_products, take):
    assert rounding()[3:] == [True, True]
    take()
    assert rounding() == ["ieee", "ieee", "ieee", False, False]


def test_a_cpu_changes_nothing(rounded_products):
    before = rounding()
    resolve_device("cpu")
    assert rounding() == before

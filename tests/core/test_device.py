"""Devices by name, with CUDA played by stand-ins."""

import pytest
import torch

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError


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

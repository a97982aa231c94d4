"""What the trainings of both networks have in common, as tasks of `training.loop`."""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor, nn

from lightprobe.training import ParameterGroup


class NetworkObjective:
    """A network whose parameters are all that a step changes; its loss is left to the subclasses."""

    recordable = True  # the loss depends on the parameters and on tensors that are handed to it

    def __init__(self, network: nn.Module, name: str, rate: float):
        """Train the parameters of `network`, called `name.<parameter>`, at one `rate`, in their own unit."""
        self._network, self._name, self._rate = network, name, rate

    def groups(self) -> list[ParameterGroup]:
        """Return the network's parameters and their rate."""
        named = {f"{self._name}.{key}": parameter for key, parameter in self._network.named_parameters()}
        return [ParameterGroup(named, self._rate)]

    def buffers(self) -> dict[str, Tensor]:
        """Return nothing: all that changes is a parameter."""
        return {}

    def load_buffers(self, tensors: Mapping[str, Tensor]) -> None:
        """Do nothing, as there are no buffers."""

    def refresh(self, iteration: int, fraction: float) -> None:
        """Do nothing: what the network learns from is at rest."""

    def project(self) -> None:
        """Do nothing: every value of a parameter is valid."""


def mixed_precision(network: nn.Module, device: torch.device) -> Callable[..., Tensor]:
    """Return the network's forward pass, in bfloat16 on a GPU that has it, to a float32 result.

    With products rounded so on a CPU both networks learn as well
    (docs/decisions/gpu-replay-and-precision.md).
    """
    apt = device.type == "cuda" and torch.cuda.get_device_capability(device) >= (8, 0)

    def forward(*inputs: Any) -> Tensor:
        # Within a recording no cast may be taken over from before it.
        with torch.autocast(device.type, torch.bfloat16, enabled=apt, cache_enabled=False):
            result: Tensor = network(*inputs)
        return result

    return forward

"""The losses of a training, read from the device in bunches."""

from collections.abc import Callable

import torch
from torch import Tensor

_ON_GPU = 25  # steps; few enough that a training gone wrong is noticed within seconds


class LossReader:
    """Hands each step's loss, as a number, to who wants to know it.

    Reading a number from a GPU waits for all that was asked of it, and leaves it idle until the next step is
    prepared. So there the losses of some steps are read at once. On a CPU nothing is gained by waiting.
    """

    def __init__(self, device: torch.device):
        self._bunch = 1 if device.type == "cpu" else _ON_GPU
        self._unread: list[tuple[Tensor, Callable[[float], None]]] = []

    def add(self, loss: Tensor, then: Callable[[float], None]) -> None:
        """Call `then` with the value of the loss (), now or within the next steps, in order."""
        self._unread.append((loss.detach(), then))
        if len(self._unread) >= self._bunch:
            self.read()

    def read(self) -> None:
        """Hand out what has not been read; to be called before anything that depends on the steps is kept."""
        unread, self._unread = self._unread, []
        if unread:
            values = torch.stack([loss for loss, _ in unread]).tolist()
            for value, (_, then) in zip(values, unread, strict=True):
                then(value)

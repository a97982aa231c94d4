"""What the tasks of all passes have in common, as tasks of `training.loop`."""

from collections.abc import Mapping
from typing import Protocol

from torch import Tensor

from lightprobe.core.checkpoint import copy_stored
from lightprobe.reconstruction.lights import Lights


class Unknowns(Protocol):
    """What a pass fits beside the lights."""

    def chosen(self) -> dict[str, Tensor]:
        """Return what is chosen and not trained, by name."""

    def project(self) -> None:
        """Bring parameters back into their valid ranges after a step."""


class PassTask:
    """A model and the photos' lights: what a checkpoint holds of them beside parameters, and their valid
    ranges.
    """

    model: Unknowns
    lights: Lights

    def buffers(self) -> dict[str, Tensor]:
        """Return what the model has chosen, and the lights that are solved."""
        return {**self.model.chosen(), **self.lights.solved()}

    def load_buffers(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over buffers; raise `KeyError` or `ValueError` where they do not fit."""
        copy_stored(tensors, self.model.chosen())
        self.lights.load_solved(tensors)

    def project(self) -> None:
        """Bring the model's parameters and the lights back into their valid ranges."""
        self.model.project()
        self.lights.clamp()

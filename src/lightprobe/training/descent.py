"""One step down a loss: gradient, bound, update; on a GPU from a recording where the loss allows it."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from lightprobe.training.adam import Adam, ParameterGroup
from lightprobe.training.recording import RecordedStep, recorder_for

Schedule = Callable[[float, int], float]  # (a group's rate, step) -> the rate of that step


def constant(rate: float, step: int) -> float:
    """Return the rate itself: the schedule of a short fit."""
    return rate


def exponential(steps: int, warm_up: int = 0) -> Schedule:
    """Return the schedule that falls to a tenth over `steps` (paper, section 4.2), after a linear warm-up."""

    def rate_at(rate: float, step: int) -> float:
        warm = 1.0 if warm_up == 0 else min(1.0, (step + 1) / warm_up)
        return rate * float(warm * 10 ** -(step / max(steps, 1)))

    return rate_at


def cosine(steps: int) -> Schedule:
    """Return the schedule whose rate falls to nothing over `steps` along half a cosine."""
    return lambda rate, step: 0.5 * (1 + math.cos(math.pi * step / steps)) * rate


class Descent:
    """Steps of Adam down a loss."""

    def __init__(
        self,
        groups: Sequence[ParameterGroup],
        loss: Callable[..., Tensor],
        *,
        schedule: Schedule = constant,
        betas: tuple[float, float] = (0.9, 0.999),
        epsilon: float = 1e-8,
        fused: bool | None = None,
        recordable: bool = False,
        largest_gradient: float | None = None,
        after: Callable[[], None] | None = None,
    ):
        """Make a descent on the parameters of `groups`.

        loss: returns the loss () of what a step is given. fused: as in `Adam`; by default only where steps
        are recorded. recordable: whether the loss depends on the parameters and the tensors it is given
        alone, so that a GPU may replay a step. largest_gradient: bound on the norm of the whole gradient.
        after: called after each update, brings parameters back into their ranges.
        """
        device = next(iter(groups[0].parameters.values())).device
        recorder = recorder_for(device) if recordable else None
        self.recorded = recorder is not None
        """Whether steps are replayed from a recording, and so take tensors."""
        fused = self.recorded if fused is None else fused
        self.adam = Adam(groups, betas=betas, epsilon=epsilon, fused=fused, recordable=self.recorded)
        self._loss, self._schedule, self._largest, self._after = loss, schedule, largest_gradient, after
        self._step = RecordedStep(self._descend, recorder)

    def step(self, number: int, *given: Any) -> Tensor:
        """Take the step `number` down the loss of what is `given`, and return that loss () without a gradient."""
        self.adam.set_rates([self._schedule(rate, number) for rate in self.adam.rates])
        return self._step(*given)

    def end(self) -> None:
        """Let go of the recording, and of the gradients that lie in its memory."""
        self._step = RecordedStep(self._descend, None)
        self.adam.forget_gradients()

    def _descend(self, *given: Any) -> Tensor:
        self.adam.forget_gradients()
        with torch.enable_grad():
            loss = self._loss(*given)
            loss.backward()
        if self._largest is not None:
            nn.utils.clip_grad_norm_(list(self.adam.parameters.values()), self._largest)
        self.adam.step()
        if self._after is not None:
            self._after()
        return loss.detach()

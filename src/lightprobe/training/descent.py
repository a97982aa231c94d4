"""One step down a loss: gradient, bound, update; on a GPU from a recording where the loss allows it.

Several processes take a step together: each finds the gradient of its own loss, and all move down the mean of
these. What they exchange lies between two recordings and in none, as whether it could depends on the GPUs and
their links.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from lightprobe.core.processes import ALONE, Processes
from lightprobe.training.adam import Adam, ParameterGroup
from lightprobe.training.recording import RecordedStep, Recorder, recorder_for

Schedule = Callable[[float, int], float]  # (a group's rate, step) -> the rate of that step


def constant(rate: float, step: int) -> float:
    """Return the rate itself: the schedule of a short fit."""
    return rate


def exponential(steps: int, warm_up: int = 0) -> Schedule:
    """Return the schedule whose rate falls to a tenth over `steps` (paper, section 4.2), after a linear
    warm-up.
    """

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
        processes: Processes = ALONE,
    ):
        """Make a descent on the parameters of `groups`.

        loss: returns the loss () of what a step is given. fused: as in `Adam`; by default only where steps
        are recorded. recordable: whether the loss depends on the parameters and the tensors it is given
        alone, so that a GPU may replay a step. largest_gradient: bound on the norm of the whole gradient.
        after: called after each update, brings parameters back into their ranges. processes: who takes the
        steps together, from equal parameters down the mean of their losses.
        """
        device = next(iter(groups[0].parameters.values())).device
        recorder = recorder_for(device) if recordable else None
        self.recorded = recorder is not None
        """Whether steps are replayed from a recording, and so take tensors."""
        fused = self.recorded if fused is None else fused
        self.adam = Adam(groups, betas=betas, epsilon=epsilon, fused=fused, recordable=self.recorded)
        self._loss, self._schedule, self._largest, self._after = loss, schedule, largest_gradient, after
        self._processes = processes
        self._step = self._step_recorded_by(recorder)

    def step(self, number: int, *given: Any) -> Tensor:
        """Take the step `number` down the loss of what is `given`, and return that loss () without a
        gradient.

        Of several processes' losses that is the mean. Raises `ResourceError` when one of them has ended.
        """
        self.adam.set_rates([self._schedule(rate, number) for rate in self.adam.rates])
        return self._step(*given)

    def end(self) -> None:
        """Let go of the recording, and of the gradients that lie in its memory."""
        self._step = self._step_recorded_by(None)
        self.adam.forget_gradients()

    def _step_recorded_by(self, recorder: Recorder | None) -> Callable[..., Tensor]:
        if self._processes.alone:
            return RecordedStep(self._descend, recorder)
        slope, move = RecordedStep(self._own_slope, recorder), RecordedStep(self._move, recorder)
        return lambda *given: move(self._processes.average(slope(*given)))

    def _descend(self, *given: Any) -> Tensor:
        loss = self._find_gradient(*given)
        self._update()
        return loss

    def _find_gradient(self, *given: Any) -> Tensor:
        self.adam.forget_gradients()
        with torch.enable_grad():
            loss = self._loss(*given)
            loss.backward()
        return loss.detach()

    def _update(self) -> None:
        if self._largest is not None:
            nn.utils.clip_grad_norm_(list(self.adam.parameters.values()), self._largest)
        self.adam.step()
        if self._after is not None:
            self._after()

    def _own_slope(self, *given: Any) -> Tensor:
        """Return this process's gradients and loss, all in one vector: one exchange costs less than many."""
        loss = self._find_gradient(*given)
        gradients = [p.grad.reshape(-1) for p in self.adam.parameters.values() if p.grad is not None]
        return torch.cat([*gradients, loss.reshape(1)])

    def _move(self, slope: Tensor) -> Tensor:
        """Update the parameters by the `slope` of all processes, and return their loss ()."""
        moving = [p for p in self.adam.parameters.values() if p.grad is not None]
        *gradients, loss = slope.split([*(p.numel() for p in moving), 1])
        for parameter, gradient in zip(moving, gradients, strict=True):
            parameter.grad = gradient.view_as(parameter)
        self._update()
        return loss[0]

"""One optimisation loop for all passes, resumable at any checkpoint, with the same bits on a CPU."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import torch
from torch import Tensor

from lightprobe.core.checkpoint import Checkpoints, stored_like
from lightprobe.core.config import DecomposeConfig
from lightprobe.core.device import generator
from lightprobe.core.errors import ConvergenceError
from lightprobe.core.losses import LossReader
from lightprobe.core.recording import Recorded, recorder_for, set_rate
from lightprobe.reconstruction.lights import Lights

OnStep = Callable[[str, int, int, float], None]  # stage, step, steps, loss


class Task(Protocol):
    """What the loop needs of a pass: its unknowns, its lights, and the loss of a step."""

    lights: Lights

    def groups(self) -> list[dict]:
        """Return the optimiser's parameter groups, lights excepted."""

    def refresh(self, iteration: int, fraction: float) -> None:
        """Update what follows the unknowns only now and then; called wherever a checkpoint may be."""

    @property
    def steady(self) -> bool:
        """Whether the loss of a step depends on the unknowns and what the step is given alone."""

    def given(self, iteration: int) -> tuple[Tensor, ...]:
        """Return what the loss of a step depends on, lights brought up to date."""

    def loss(self, iteration: int, fraction: float, *given: Tensor) -> Tensor:
        """Return the loss of a step; `fraction` of the pass is over."""

    def photos(self, iteration: int) -> str:
        """Return the names of the photos that a step looks at."""

    def project(self) -> None:
        """Bring parameters back into their valid ranges after a step."""


@dataclass(frozen=True)
class Stage:
    """Name and length of a pass, and where it lies in the run's step count."""

    name: str
    first_step: int
    iterations: int
    warm_up: int = 0  # steps over which the learning rates rise from nothing

    def rate(self, iteration: int) -> float:
        """Return what share of the learning rates a step takes."""
        warm = 1.0 if self.warm_up == 0 else min(1.0, (iteration + 1) / self.warm_up)
        return float(warm * 10 ** -(iteration / max(self.iterations, 1)))


@dataclass
class Progress:
    """Where checkpoints go and who is told what happens. Extra tensors travel in every checkpoint."""

    checkpoints: Checkpoints | None = None
    on_step: OnStep | None = None
    on_message: Callable[[str], None] | None = None
    extra: dict[str, Tensor] = field(default_factory=dict)

    def restoring(self, step: int) -> AbstractContextManager[None]:
        """Return what names the checkpoint of `step` when it turns out not to fit; nothing where there are none."""
        return self.checkpoints.restoring(step) if self.checkpoints else nullcontext()

    def step(self, stage: str, step: int, steps: int, loss: float) -> None:
        """Report a finished step."""
        if self.on_step:
            self.on_step(stage, step, steps, loss)

    def tell(self, message: str) -> None:
        """Report something worth a line in the log."""
        if self.on_message:
            self.on_message(message)


def photo_order(seed: int, stage: str, count: int, step: int) -> int:
    """Return the photo visited at `step`: every epoch is a fresh permutation that depends only on (seed, epoch)."""
    epoch, place = divmod(step, count)
    return int(torch.randperm(count, generator=generator(seed, f"order/{stage}", epoch))[place])


def optimise(task: Task, stage: Stage, config: DecomposeConfig, progress: Progress, done: int = 0,
             restored: dict[str, Tensor] | None = None) -> None:  # fmt: skip
    """Run `stage` from iteration `done`; `restored` holds the tensors of the checkpoint taken there.

    All learning rates fall exponentially to a tenth over the stage (paper, section 4.2), after its warm-up.
    """
    groups, lights = task.groups(), task.lights
    if lights.gradient:
        groups.append({"params": lights.maps, "lr": config.learning_rate_light})
    rates = [group["lr"] for group in groups]
    device = lights.maps[0].device
    recorder = recorder_for(device) if task.steady else None
    if recorder is not None:  # a recording would keep Python's numbers
        groups = [{**group, "lr": torch.tensor(rate, device=device)} for group, rate in zip(groups, rates, strict=True)]
    optimiser = torch.optim.Adam(
        groups, betas=(0.9, config.adam_decay), eps=config.adam_epsilon, fused=True, capturable=recorder is not None
    )
    names = [f"p{i}" for i in range(sum(len(list(g["params"])) for g in optimiser.param_groups))]
    if restored is not None:
        with progress.restoring(stage.first_step + done):
            _restore(optimiser, names, lights, restored)
    losses = LossReader(device)

    def take_note(iteration: int, value: float) -> None:
        if not math.isfinite(value):
            raise ConvergenceError(
                f"The loss became {value} in {stage.name} at step {iteration} on photo {task.photos(iteration)}; "
                "lower the learning rates or inspect this photo."
            )
        progress.step(stage.name, iteration + 1, stage.iterations, value)

    def descend(iteration: int, fraction: float, given: tuple[Tensor, ...]) -> Tensor:
        optimiser.zero_grad(set_to_none=True)
        loss = task.loss(iteration, fraction, *given)
        loss.backward()
        optimiser.step()
        task.project()
        lights.clamp()
        return loss.detach()

    recorded = Recorded(lambda *given: descend(done, 0.0, given), recorder)

    for iteration in range(done, stage.iterations):
        fraction = iteration / max(stage.iterations, 1)
        if iteration % config.checkpoint_every == 0:
            task.refresh(iteration, fraction)
        for group, rate in zip(optimiser.param_groups, rates, strict=True):
            set_rate(group, rate * stage.rate(iteration))
        given = task.given(iteration)
        loss = descend(iteration, fraction, given) if recorder is None else recorded(*given)
        losses.add(loss, partial(take_note, iteration))
        if (iteration + 1) % config.checkpoint_every and iteration + 1 < stage.iterations:
            continue
        losses.read()  # before a checkpoint, which must not keep what has gone wrong
        if progress.checkpoints:
            tensors = {**_tensors(optimiser, names, lights), **progress.extra}
            state = {"stage": stage.name, "iteration": iteration + 1}
            progress.checkpoints.save(stage.first_step + iteration + 1, tensors, state)
    optimiser.zero_grad(set_to_none=True)  # a recording's memory would stay with them


def _parameters(optimiser: torch.optim.Optimizer) -> list[Tensor]:
    return [p for group in optimiser.param_groups for p in group["params"]]


def _tensors(optimiser: torch.optim.Optimizer, names: list[str], lights: Lights) -> dict[str, Tensor]:
    """Return parameters, Adam state and lights by name."""
    tensors = {"lights": torch.stack([light.detach() for light in lights.maps])}
    for name, parameter in zip(names, _parameters(optimiser), strict=True):
        tensors[name] = parameter.detach()
        for key, value in optimiser.state.get(parameter, {}).items():
            tensors[f"{name}.{key}"] = value
    return tensors


@torch.no_grad()
def _restore(optimiser: torch.optim.Optimizer, names: list[str], lights: Lights, tensors: dict[str, Tensor]) -> None:
    lights.load(tensors["lights"])
    for name, parameter in zip(names, _parameters(optimiser), strict=True):
        parameter.copy_(stored_like(tensors, name, parameter))
        if f"{name}.exp_avg" in tensors:
            moments = {k: stored_like(tensors, f"{name}.{k}", parameter) for k in ("exp_avg", "exp_avg_sq")}
            step = stored_like(tensors, f"{name}.step", parameter.new_zeros(()))
            optimiser.state[parameter] = {"step": step, **moments}

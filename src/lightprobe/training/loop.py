"""The loop over a stage's steps, and its checkpoints: one way and one format for both phases.

A phase is trained in stages, one after the other. A checkpoint holds, by name,

    parameter.<name>  adam_mean.<name>  adam_square.<name>  adam_updates.<name>    of every parameter
    buffer.<name>     what the stage changes without a gradient
    start.<name>      what the stage started from, the same in all its checkpoints

and in its state phase, stage, the stage's steps done, configuration and seed. The random streams depend on
seed and step alone, so a resumed training ends with the bits of an uninterrupted one on a CPU; a GPU adds
gradients in an order of its own.
"""

import json
import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import torch
from torch import Tensor

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.device import generator
from lightprobe.core.errors import ConfigError, ConvergenceError
from lightprobe.training.adam import ParameterGroup
from lightprobe.training.descent import Descent, Schedule, constant

OnStep = Callable[[str, int, int, float], None]  # stage, step, steps, loss
_BUFFER, _START = "buffer.", "start."
_ON_GPU = 25  # steps; few enough that a training gone wrong is noticed within seconds


class Objective(Protocol):
    """What the loop needs of a stage: its unknowns, and the loss of a step."""

    def groups(self) -> list[ParameterGroup]:
        """Return the parameters and their rates."""

    def buffers(self) -> dict[str, Tensor]:
        """Return what else changes from step to step, by name: it travels in every checkpoint."""

    def load_buffers(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over buffers; raise `KeyError` or `ValueError` where they do not fit."""

    def refresh(self, iteration: int, fraction: float) -> None:
        """Update what follows the unknowns only now and then; called wherever a checkpoint may be."""

    @property
    def recordable(self) -> bool:
        """Whether the loss of a step depends on the parameters and what the step is given alone."""

    def given(self, iteration: int) -> tuple[Tensor, ...]:
        """Return what the loss of a step depends on: tensors of any shape."""

    def loss(self, iteration: int, fraction: float, *given: Tensor) -> Tensor:
        """Return the loss () of a step; `fraction` of the stage is over."""

    def photos(self, iteration: int) -> str:
        """Return the names of the photos that a step looks at."""

    def project(self) -> None:
        """Bring parameters back into their valid ranges after a step."""


@dataclass(frozen=True)
class Stage:
    """A part of a phase: its name and length, its first step in the phase's count, and how it descends."""

    name: str
    first_step: int
    iterations: int
    schedule: Schedule = constant
    betas: tuple[float, float] = (0.9, 0.999)
    epsilon: float = 1e-8
    largest_gradient: float | None = None  # norm


@dataclass
class Progress:
    """Where checkpoints go and who is told what happens."""

    checkpoints: Checkpoints | None = None
    on_step: OnStep | None = None
    on_message: Callable[[str], None] | None = None
    on_checkpoint: Callable[[], None] | None = None  # after each one that is saved
    on_score: Callable[[str, float, float], None] | None = (
        None  # stage, dB on held-out photos before and after
    )

    def step(self, stage: str, step: int, steps: int, loss: float) -> None:
        """Report a finished step."""
        if self.on_step:
            self.on_step(stage, step, steps, loss)

    def score(self, stage: str, before: float, after: float) -> None:
        """Report the PSNR in dB of held-out photos before a stage and after it."""
        if self.on_score:
            self.on_score(stage, before, after)

    def tell(self, message: str) -> None:
        """Report something worth a line in the log."""
        if self.on_message:
            self.on_message(message)


@dataclass(frozen=True)
class Resumed:
    """The newest checkpoint of a phase."""

    stage: str
    done: int  # steps of the stage
    step: int  # of the phase
    tensors: dict[str, Tensor]

    @property
    def start(self) -> dict[str, Tensor]:
        """What the stage started from, by name."""
        return without_prefix(_START, self.tensors)


@dataclass(frozen=True)
class Training:
    """A phase's training: what it is, where its checkpoints go, and who hears of its steps."""

    phase: str  # "Phase I" or "Phase II"
    config: dict[str, Any]  # what JSON can hold
    seed: int
    stages: tuple[Stage, ...]
    checkpoint_every: int  # steps
    progress: Progress = field(default_factory=Progress)

    def stage(self, name: str) -> Stage:
        """Return the stage of that name; raise `ValueError` when there is none."""
        found = next((stage for stage in self.stages if stage.name == name), None)
        if found is None:
            raise ValueError(f"its state names no stage of {self.phase}")
        return found

    def restoring(self, step: int) -> AbstractContextManager[None]:
        """Return what names the checkpoint of `step` when it does not fit; nothing without checkpoints."""
        checkpoints = self.progress.checkpoints
        return checkpoints.restoring(step) if checkpoints else nullcontext()

    def latest(self) -> Resumed | None:
        """Return the newest checkpoint, None without one.

        Raises `ConfigError` for one of another configuration or seed, `InputError` for one of another training.
        """
        checkpoints = self.progress.checkpoints
        latest = checkpoints.latest() if checkpoints else None
        if checkpoints is None or latest is None:
            return None
        step, tensors, state = latest
        with self.restoring(step):
            phase, name, done = state["phase"], state["stage"], state["iteration"]
            config, seed = state["config"], state["seed"]
            if phase != self.phase:
                raise ValueError(f"it is of {phase!r}, not of {self.phase}")
            stage = self.stage(name)
            if type(done) is not int or not 0 <= done <= stage.iterations or step != stage.first_step + done:
                raise ValueError(f"its state names step {done} of {name}")
        if config != json.loads(json.dumps(self.config)) or seed != self.seed:
            raise ConfigError(
                f"The checkpoints of this run come from another {self.phase} configuration or seed; "
                "use the same options, or remove the run's checkpoints to start anew."
            )
        checkpoints.prune()
        return Resumed(name, done, step, tensors)

    def save(self, stage: Stage, done: int, tensors: dict[str, Tensor]) -> None:
        """Write the checkpoint of a stage after `done` steps, if there are checkpoints."""
        if self.progress.checkpoints:
            state = {"phase": self.phase, "stage": stage.name, "iteration": done, "config": self.config}
            self.progress.checkpoints.save(stage.first_step + done, tensors, {**state, "seed": self.seed})
            if self.progress.on_checkpoint:
                self.progress.on_checkpoint()

    def begin(self, stage: Stage, start: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Write the checkpoint from which `stage` starts, the one before being over for good; return `start`."""
        self.save(stage, 0, {_START + name: tensor.detach() for name, tensor in start.items()})
        return dict(start)

    def run(
        self,
        objective: Objective,
        stage: Stage,
        resumed: Resumed | None = None,
        start: Mapping[str, Tensor] | None = None,
    ) -> None:
        """Take all steps of a stage, or those that are left after the checkpoint `resumed`.

        start: what the stage starts from, by name, to be kept in its checkpoints. Raises `ConvergenceError`
        when the loss stops being finite.
        """
        now = [0]  # a recorded loss does not look at it

        def loss(*given: Tensor) -> Tensor:
            return objective.loss(now[0], now[0] / max(stage.iterations, 1), *given)

        descent = Descent(
            objective.groups(),
            loss,
            schedule=stage.schedule,
            betas=stage.betas,
            epsilon=stage.epsilon,
            fused=True,
            recordable=objective.recordable,
            largest_gradient=stage.largest_gradient,
            after=objective.project,
        )
        done = 0 if resumed is None else resumed.done
        if resumed is not None and done > 0:
            with self.restoring(resumed.step):
                objective.load_buffers(without_prefix(_BUFFER, resumed.tensors))
                descent.adam.load(resumed.tensors)
        kept = {_START + name: tensor.detach() for name, tensor in (start or {}).items()}
        losses = LossReader(next(iter(descent.adam.parameters.values())).device)
        for iteration in range(done, stage.iterations):
            now[0] = iteration
            if iteration % self.checkpoint_every == 0:
                objective.refresh(iteration, iteration / max(stage.iterations, 1))
            loss_of_step = descent.step(iteration, *objective.given(iteration))
            losses.add(loss_of_step, partial(self._note, objective, stage, iteration))
            if (iteration + 1) % self.checkpoint_every and iteration + 1 < stage.iterations:
                continue
            losses.read()  # before a checkpoint, which must not keep what has gone wrong
            buffers = {_BUFFER + name: tensor.detach() for name, tensor in objective.buffers().items()}
            self.save(stage, iteration + 1, {**descent.adam.state(), **buffers, **kept})
        descent.end()

    def _note(self, objective: Objective, stage: Stage, iteration: int, value: float) -> None:
        if not math.isfinite(value):
            raise ConvergenceError(
                f"The loss became {value} in {stage.name} at step {iteration} on photo {objective.photos(iteration)}; "
                "lower the learning rates or inspect this photo."
            )
        self.progress.step(stage.name, iteration + 1, stage.iterations, value)


class LossReader:
    """Hands each step's loss, as a number, to a listener.

    Reading a number from a GPU waits for all its work and leaves it idle until the next step is prepared, so
    there the losses of some steps are read at once.
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


def visited(seed: int, stream: str, count: int, step: int) -> int:
    """Return which of `count` photos `step` visits: each once an epoch, in the epoch's own order."""
    epoch, place = divmod(step, count)
    return int(torch.randperm(count, generator=generator(seed, stream, epoch))[place])


def without_prefix(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the tensors (any shape) whose names begin with `prefix`, without it."""
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}

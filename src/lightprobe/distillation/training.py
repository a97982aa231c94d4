"""Phase II training: the illumination MLP photo by photo, then the sphere network on what the MLP makes of the photos.

The random streams depend on (seed, step) alone and the optimiser's moments are in the checkpoint, so a resumed run
ends with the bits of an uninterrupted one on a CPU; a GPU adds gradients in an order of its own.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn

from lightprobe.core.checkpoint import Checkpoints, stored_like
from lightprobe.core.config_distill import DistillConfig, RadianceUnit
from lightprobe.core.device import full_precision, generator
from lightprobe.core.errors import ConfigError, ConvergenceError
from lightprobe.core.losses import LossReader
from lightprobe.core.recording import Recorded, recorder_for, set_rate
from lightprobe.distillation.loss import intensity_weight, sample_weight, weighted_l2
from lightprobe.distillation.sphere_training import batch, fill_album, learning_rate, sphere_loss
from lightprobe.lessons.lesson import Lesson
from lightprobe.lessons.lessons import collect_lessons
from lightprobe.light import cubemap
from lightprobe.models import Decomposition
from lightprobe.models.illumination_mlp import IlluminationMlp
from lightprobe.models.probe_distribution import stack
from lightprobe.models.probe_model import ProbeModel, new_network, new_sphere, starts_pretrained
from lightprobe.models.probe_pixels import ProbePixels
from lightprobe.models.sampling import sample_pixels
from lightprobe.models.sphere_net import SphereNet
from lightprobe.scene.photo import Scene

_MOMENTS = ("exp_avg", "exp_avg_sq")
_LARGEST_GRADIENT = 1.0
_START_KEPT = 0.5

OnStep = Callable[[int, float], None]  # (step, loss), after every step


def distill(
    decomposition: Decomposition,
    scene: Scene,
    config: DistillConfig | None = None,
    device: torch.device | None = None,
    seed: int = 0,
    checkpoints: Checkpoints | None = None,
    on_step: OnStep | None = None,
    *,
    maps: Sequence[Tensor] = (),
    on_lesson: Callable[[int, int], None] | None = None,
) -> ProbeModel:
    """Train the predictors on the scene's training photos and on re-rendered ones, and return the model.

    Without `config` the preset `quick`, without `device` the CPU.
    maps: environments (6, R, R, 3), z up, to re-render under as well. on_lesson: hears of (done, all) photos prepared.
    Raises `InputError` when no photo shows the object, `ConfigError` when `checkpoints` holds another configuration's
    state, `ConvergenceError` when the loss stops being finite.
    """
    config, device = config or DistillConfig(), full_precision(device or torch.device("cpu"))
    lessons = collect_lessons(
        decomposition.asset, decomposition.lights, scene, config, device, seed, maps, on_lesson
    )  # fmt: skip
    return train(lessons, config, device, seed, checkpoints, on_step)


def train(
    lessons: list[Lesson],
    config: DistillConfig,
    device: torch.device,
    seed: int,
    checkpoints: Checkpoints | None = None,
    on_step: OnStep | None = None,
) -> ProbeModel:
    """Train on lessons already collected; the rest as in `distill`."""
    course = _Course(config, device, seed, checkpoints, on_step)
    for step in range(course.done, config.steps):
        lesson = _lesson(lessons, seed, step)
        course.take("network", lesson_tensors(lesson, config, seed, step), config.learning_rate, lesson.name)
    course.rest("network")
    if config.sphere_steps:
        album = fill_album(course.network, lessons, config, seed)
        for step in range(course.done - config.steps, config.sphere_steps):
            course.take("sphere", batch(album, config, seed, step), learning_rate(config, step), "several")
        course.rest("sphere")
    side = config.light_resolution
    mean = torch.stack([lesson.teacher for lesson in lessons]).mean(0).reshape(6, side, side, 3)
    sphere = _learned(course.sphere, config, seed).requires_grad_(False) if config.sphere_steps else None
    return ProbeModel(course.network.requires_grad_(False), mean, lessons[0].up, config, sphere)


@torch.no_grad()
def _learned(sphere: SphereNet, config: DistillConfig, seed: int) -> SphereNet:
    """Return the trained network, halfway back to the bundled one if it came from there.

    One object's few lessons teach its errors and make the network forget what lights are like. The mean of the weights
    before and after keeps both, at no cost (Wortsman et al. 2022, "Robust fine-tuning of zero-shot models").
    """
    if starts_pretrained(config):
        start = dict(new_sphere(config, seed).named_parameters())
        for name, parameter in sphere.named_parameters():
            parameter.lerp_(start[name].to(parameter.device), _START_KEPT)
    return sphere


def lesson_tensors(lesson: Lesson, config: DistillConfig, seed: int, step: int) -> tuple[Tensor, ...]:
    """Return what `lesson_loss` needs of one photo, with the pixels drawn for `step`."""
    chosen = sample_pixels(lesson.pixels.roughness, config.samples, seed=seed, stream="distill-pixels", step=step)
    return (*lesson.pixels.take(chosen).tensors(), lesson.light_level, lesson.distribution, lesson.teacher)


def lesson_loss(
    network: Callable[[ProbePixels, Tensor], Tensor], given: Sequence[Tensor], directions: Tensor,
    solid_angles: Tensor, config: DistillConfig,
) -> Tensor:  # fmt: skip
    """Return Equation 6 () of the illumination MLP for one photo, `given` as `lesson_tensors`."""
    *fields, light_level, distribution, teacher = given
    pixels = ProbePixels(*fields)
    colors = network(pixels, light_level)
    if config.radiance_unit is RadianceUnit.LEVEL:
        colors = colors / light_level
    else:
        teacher = teacher * light_level
    predicted, sampled = stack(pixels, colors, directions, config.alpha_rule)
    weight = torch.ones_like(sampled)
    if config.sample_weight:
        weight = weight * sample_weight(sampled, distribution)
    if config.intensity_weight:
        weight = weight * intensity_weight(teacher, config.radiance_unit)
    return weighted_l2(predicted, teacher, weight, solid_angles, config.loss_space)


def _lesson(lessons: list[Lesson], seed: int, step: int) -> Lesson:
    """Return the photo of `step`: every photo once per epoch, in an order of the epoch's own."""
    epoch, position = divmod(step, len(lessons))
    order = torch.randperm(len(lessons), generator=generator(seed, "distill-photo", epoch))
    return lessons[int(order[position])]


def _mixed(network: nn.Module, device: torch.device) -> Callable[..., Tensor]:
    """Return the network's forward pass, in bfloat16 on a GPU that has it, to a float32 result.

    With products rounded so on a CPU both networks learn as well (docs/decisions/gpu-replay-and-precision.md).
    """
    apt = device.type == "cuda" and torch.cuda.get_device_capability(device) >= (8, 0)

    def forward(*inputs: Any) -> Tensor:
        # Within a recording no cast may be taken over from before it.
        with torch.autocast(device.type, torch.bfloat16, enabled=apt, cache_enabled=False):
            result: Tensor = network(*inputs)
        return result

    return forward


class _Learner:
    """A network, its loss and its optimiser; on a GPU a step is one recording."""

    def __init__(self, network: nn.Module, loss: Callable[..., Tensor], device: torch.device, *, bounded: bool):
        """Take the loss () of the tensors that a step is given; `bounded` holds the gradient within its limit."""
        self.network, self._loss, self._bounded = network, loss, bounded
        recorder = recorder_for(device)
        # A recording would keep Python's number.
        rate = 0.0 if recorder is None else torch.zeros((), device=device)
        self.optimizer = torch.optim.Adam(network.parameters(), lr=rate, fused=True, capturable=recorder is not None)
        self._step = Recorded(self._learn, recorder)

    def step(self, given: Sequence[Tensor], rate: float) -> Tensor:
        """Take one step down the loss of `given` and return it."""
        set_rate(self.optimizer.param_groups[0], rate)
        return self._step(*given)

    def rest(self) -> None:
        """Let go of the recording, and of the gradients that lie in its memory."""
        self._step = Recorded(self._learn, None)
        self.optimizer.zero_grad(set_to_none=True)

    def _learn(self, *given: Tensor) -> Tensor:
        self.optimizer.zero_grad(set_to_none=True)
        loss = self._loss(*given)
        loss.backward()
        if self._bounded:
            nn.utils.clip_grad_norm_(self.network.parameters(), _LARGEST_GRADIENT)
        self.optimizer.step()
        return loss.detach()


class _Course:
    """Both networks, one after the other, and the place in the course."""

    def __init__(
        self, config: DistillConfig, device: torch.device, seed: int, checkpoints: Checkpoints | None,
        on_step: OnStep | None,
    ):  # fmt: skip
        """Begin, or go on from the newest checkpoint if there is one."""
        self.config, self.seed, self.checkpoints, self.on_step = config, seed, checkpoints, on_step
        self.network: IlluminationMlp = new_network(config, seed).to(device)
        self.sphere: SphereNet = new_sphere(config, seed).to(device)
        directions = cubemap.directions(config.light_resolution, device).reshape(-1, 3)
        solid_angles = cubemap.solid_angles(config.light_resolution).to(device).reshape(-1)
        if not config.solid_angle_weight:
            solid_angles = torch.full_like(solid_angles, 4 * math.pi / len(solid_angles))

        network, sphere = (_mixed(module, device) for module in (self.network, self.sphere))

        def mlp_loss(*given: Tensor) -> Tensor:
            return lesson_loss(network, given, directions, solid_angles, config)

        def net_loss(maps: Tensor, lights: Tensor) -> Tensor:
            return sphere_loss(sphere(maps), lights)

        self._learners = {
            "network": _Learner(self.network, mlp_loss, device, bounded=False),
            "sphere": _Learner(self.sphere, net_loss, device, bounded=True),
        }
        self._losses = LossReader(device)
        self.done = self._resume()

    def take(self, name: str, given: Sequence[Tensor], rate: float, photo: str) -> None:
        """Take one step of the network `name`; save and report."""
        loss = self._learners[name].step(given, rate)
        self.done += 1
        self._losses.add(loss, partial(self._take_note, self.done, photo))
        if self.done % self.config.checkpoint_every and self.done not in (self.config.steps, self.config.total_steps):
            return
        self._losses.read()  # before a checkpoint, which must not keep what has gone wrong
        if self.checkpoints is not None:
            self._save(self.checkpoints)

    def rest(self, name: str) -> None:
        """Free what only the training of the network `name` needs."""
        self._learners[name].rest()

    def _take_note(self, step: int, photo: str, value: float) -> None:
        if not math.isfinite(value):
            raise ConvergenceError(f"Distillation lost its footing at step {step - 1} (photo {photo}): {value} loss.")
        if self.on_step is not None:
            self.on_step(step, value)

    def _save(self, checkpoints: Checkpoints) -> None:
        tensors = {}
        for prefix, learner in self._learners.items():
            for name, parameter in learner.network.named_parameters():
                tensors[f"{prefix}.{name}"] = parameter.detach()
                for moment, value in learner.optimizer.state.get(parameter, {}).items():
                    if moment in _MOMENTS:
                        tensors[f"{moment}.{prefix}.{name}"] = value
        checkpoints.save(self.done, tensors, {"config": asdict(self.config), "seed": self.seed})

    def _resume(self) -> int:
        """Put the newest checkpoint, if there is one, into the networks and optimisers; return the steps done."""
        latest = None if self.checkpoints is None else self.checkpoints.latest()
        if self.checkpoints is None or latest is None:
            return 0
        done, tensors, state = latest
        with self.checkpoints.restoring(done):
            config, seed = DistillConfig.from_json(state["config"]), state["seed"]
        if config != self.config or seed != self.seed:
            raise ConfigError(
                "The checkpoints of this run come from another Phase II configuration or seed; "
                "use the same options, or remove the run's checkpoints to start anew."
            )
        with self.checkpoints.restoring(done):
            if not 0 < done <= self.config.total_steps:
                raise ValueError(f"it is of step {done}")
            self._restore(done, tensors)
        return done

    @torch.no_grad()
    def _restore(self, done: int, tensors: dict[str, Tensor]) -> None:
        counts = {"network": min(done, self.config.steps), "sphere": done - self.config.steps}
        for prefix, learner in self._learners.items():
            for name, parameter in learner.network.named_parameters():
                parameter.copy_(stored_like(tensors, f"{prefix}.{name}", parameter))
                if counts[prefix] > 0:
                    moments = {m: stored_like(tensors, f"{m}.{prefix}.{name}", parameter) for m in _MOMENTS}
                    step = torch.tensor(float(counts[prefix]), device=parameter.device)
                    learner.optimizer.state[parameter] = {"step": step, **moments}

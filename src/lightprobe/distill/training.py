"""Phase II training: the illumination MLP photo by photo, then the sphere network on what the MLP makes of the photos.

The random streams depend on (seed, step) alone and the optimiser's moments are in the checkpoint, so a resumed run
ends with the bits of an uninterrupted one.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial

import torch
from torch import Tensor, nn

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.config_distill import DistillConfig
from lightprobe.core.device import generator
from lightprobe.core.errors import ConfigError, ConvergenceError
from lightprobe.core.losses import LossReader
from lightprobe.decompose import Decomposition
from lightprobe.distill.illumination_mlp import IlluminationMlp
from lightprobe.distill.lesson import Lesson
from lightprobe.distill.lessons import collect_lessons
from lightprobe.distill.loss import intensity_weight, sample_weight, weighted_l2
from lightprobe.distill.probe_distribution import stack
from lightprobe.distill.probe_model import ProbeModel, new_network, new_sphere, starts_pretrained
from lightprobe.distill.sampling import sample_pixels
from lightprobe.distill.sphere_net import SphereNet
from lightprobe.distill.sphere_training import batch, fill_album, learning_rate, sphere_loss
from lightprobe.light import cubemap
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
    config, device = config or DistillConfig(), device or torch.device("cpu")
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
    directions = cubemap.directions(config.light_resolution, device).reshape(-1, 3)
    solid_angles = cubemap.solid_angles(config.light_resolution).to(device).reshape(-1)
    for step in range(course.done, config.steps):
        lesson = _lesson(lessons, seed, step)
        loss = lesson_loss(course.network, lesson, directions, solid_angles, config, seed, step)
        course.take(course.network, loss, config.learning_rate, lesson.name)
    if config.sphere_steps:
        album = fill_album(course.network, lessons, config, seed)
        for step in range(course.done - config.steps, config.sphere_steps):
            maps, lights = batch(album, config, seed, step)
            loss = sphere_loss(course.sphere(maps), lights)
            course.take(course.sphere, loss, learning_rate(config, step), "several")
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


def lesson_loss(
    network: IlluminationMlp,
    lesson: Lesson,
    directions: Tensor,
    solid_angles: Tensor,
    config: DistillConfig,
    seed: int,
    step: int,
) -> Tensor:
    """Return Equation 6 () for one photo with the pixels drawn for `step`."""
    chosen = sample_pixels(lesson.pixels.roughness, config.samples, seed=seed, stream="distill-pixels", step=step)
    pixels = lesson.pixels.take(chosen)
    colors = network(pixels, lesson.light_level) / lesson.light_level
    predicted, sampled = stack(pixels, colors, directions, config.alpha_rule)
    weight = torch.ones_like(sampled)
    if config.sample_weight:
        weight = weight * sample_weight(sampled, lesson.distribution)
    if config.intensity_weight:
        weight = weight * intensity_weight(lesson.teacher)
    return weighted_l2(predicted, lesson.teacher, weight, solid_angles, config.loss_space)


def _lesson(lessons: list[Lesson], seed: int, step: int) -> Lesson:
    """Return the photo of `step`: every photo once per epoch, in an order of the epoch's own."""
    epoch, position = divmod(step, len(lessons))
    order = torch.randperm(len(lessons), generator=generator(seed, "distill-photo", epoch))
    return lessons[int(order[position])]


class _Course:
    """Both networks, one after the other, with their optimisers and the place in the course."""

    def __init__(
        self, config: DistillConfig, device: torch.device, seed: int, checkpoints: Checkpoints | None,
        on_step: OnStep | None,
    ):  # fmt: skip
        """Begin, or go on from the newest checkpoint if there is one."""
        self.config, self.seed, self.checkpoints, self.on_step = config, seed, checkpoints, on_step
        self.network: IlluminationMlp = new_network(config, seed).to(device)
        self.sphere: SphereNet = new_sphere(config, seed).to(device)
        self._modules: dict[str, nn.Module] = {"network": self.network, "sphere": self.sphere}
        self._optimizers = {
            name: torch.optim.Adam(module.parameters(), fused=True) for name, module in self._modules.items()
        }
        self._losses = LossReader(device)
        self.done = self._resume()

    def take(self, module: nn.Module, loss: Tensor, rate: float, photo: str) -> None:
        """Take one step of `module` down its loss; save and report."""
        optimizer = self._optimizers["sphere" if module is self.sphere else "network"]
        optimizer.param_groups[0]["lr"] = rate
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        if module is self.sphere:
            nn.utils.clip_grad_norm_(module.parameters(), _LARGEST_GRADIENT)
        optimizer.step()
        self.done += 1
        self._losses.add(loss, partial(self._take_note, self.done, photo))
        if self.done % self.config.checkpoint_every and self.done not in (self.config.steps, self.config.total_steps):
            return
        self._losses.read()  # before a checkpoint, which must not keep what has gone wrong
        if self.checkpoints is not None:
            self._save(self.checkpoints)

    def _take_note(self, step: int, photo: str, value: float) -> None:
        if not math.isfinite(value):
            raise ConvergenceError(f"Distillation lost its footing at step {step - 1} (photo {photo}): {value} loss.")
        if self.on_step is not None:
            self.on_step(step, value)

    def _save(self, checkpoints: Checkpoints) -> None:
        tensors = {}
        for prefix, module in self._modules.items():
            for name, parameter in module.named_parameters():
                tensors[f"{prefix}.{name}"] = parameter.detach()
                for moment, value in self._optimizers[prefix].state.get(parameter, {}).items():
                    if moment in _MOMENTS:
                        tensors[f"{moment}.{prefix}.{name}"] = value
        checkpoints.save(self.done, tensors, {"config": asdict(self.config), "seed": self.seed})

    def _resume(self) -> int:
        """Put the newest checkpoint, if there is one, into the networks and optimisers; return the steps done."""
        latest = None if self.checkpoints is None else self.checkpoints.latest()
        if latest is None:
            return 0
        done, tensors, state = latest
        if DistillConfig.from_json(state["config"]) != self.config or state["seed"] != self.seed:
            raise ConfigError(
                "The checkpoints of this run come from another Phase II configuration or seed; "
                "use the same options, or remove the run's checkpoints to start anew."
            )
        counts = {"network": min(done, self.config.steps), "sphere": done - self.config.steps}
        for prefix, module in self._modules.items():
            for name, parameter in module.named_parameters():
                with torch.no_grad():
                    parameter.copy_(tensors[f"{prefix}.{name}"])
                if counts[prefix] > 0:
                    moments = {m: tensors[f"{m}.{prefix}.{name}"].to(parameter.device) for m in _MOMENTS}
                    step = torch.tensor(float(counts[prefix]), device=parameter.device)
                    state_of = {"step": step, **moments}
                    self._optimizers[prefix].state[parameter] = state_of
        return done

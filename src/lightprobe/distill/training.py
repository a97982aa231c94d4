"""Phase II training: each step stacks the probes of one photo and compares them with its Phase I environment.

The random streams depend on (seed, step) alone and the optimiser's moments are in the checkpoint, so a resumed run
ends with the bits of an uninterrupted one.
"""

from collections.abc import Callable
from dataclasses import asdict

import torch
from torch import Tensor

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.config_distill import DistillConfig
from lightprobe.core.device import generator
from lightprobe.core.errors import ConfigError, ConvergenceError
from lightprobe.decompose import Decomposition
from lightprobe.distill.illumination_mlp import IlluminationMlp
from lightprobe.distill.lessons import Lesson, collect_lessons
from lightprobe.distill.loss import intensity_weight, sample_weight, weighted_l2
from lightprobe.distill.probe_distribution import stack
from lightprobe.distill.probe_model import ProbeModel, new_network
from lightprobe.distill.sampling import sample_pixels
from lightprobe.light import cubemap
from lightprobe.scene.photo import Scene

_MOMENTS = ("exp_avg", "exp_avg_sq")

OnStep = Callable[[int, float], None]  # (step, loss), after every step


def distill(
    decomposition: Decomposition,
    scene: Scene,
    config: DistillConfig,
    device: torch.device,
    seed: int,
    checkpoints: Checkpoints | None = None,
    on_step: OnStep | None = None,
) -> ProbeModel:
    """Train the illumination MLP on the scene's training photos (sections 3.2 and 3.3) and return the model.

    Raises `InputError` when no photo shows the object, `ConfigError` when `checkpoints` holds another configuration's
    state, `ConvergenceError` when the loss stops being finite.
    """
    lessons = collect_lessons(decomposition.asset, decomposition.lights, scene, config, device, seed)
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
    network = new_network(config, seed).to(device)
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    start = _resume(network, optimizer, config, seed, checkpoints)
    directions = cubemap.directions(config.light_resolution, device).reshape(-1, 3)
    solid_angles = cubemap.solid_angles(config.light_resolution).to(device).reshape(-1)
    for step in range(start, config.steps):
        lesson = _lesson(lessons, seed, step)
        loss = lesson_loss(network, lesson, directions, solid_angles, config, seed, step)
        value = float(loss.detach())
        if not torch.isfinite(loss.detach()):
            raise ConvergenceError(f"Distillation lost its footing at step {step} (photo {lesson.name}): {value} loss.")
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        if on_step is not None:
            on_step(step + 1, value)
        if checkpoints is not None and ((step + 1) % config.checkpoint_every == 0 or step + 1 == config.steps):
            _save(network, optimizer, config, seed, step + 1, checkpoints)
    side = config.light_resolution
    mean = torch.stack([lesson.teacher for lesson in lessons]).mean(0).reshape(6, side, side, 3)
    return ProbeModel(network.requires_grad_(False), mean, config)


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


def _save(
    network: IlluminationMlp,
    optimizer: torch.optim.Adam,
    config: DistillConfig,
    seed: int,
    step: int,
    checkpoints: Checkpoints,
) -> None:
    tensors = {}
    for name, parameter in network.named_parameters():
        tensors[f"network.{name}"] = parameter.detach()
        for moment in _MOMENTS:
            tensors[f"{moment}.{name}"] = optimizer.state[parameter][moment]
    checkpoints.save(step, tensors, {"config": asdict(config), "seed": seed})


def _resume(
    network: IlluminationMlp,
    optimizer: torch.optim.Adam,
    config: DistillConfig,
    seed: int,
    checkpoints: Checkpoints | None,
) -> int:
    """Put the newest checkpoint, if there is one, into the network and the optimiser; return the next step."""
    latest = None if checkpoints is None else checkpoints.latest()
    if latest is None:
        return 0
    step, tensors, state = latest
    if DistillConfig.from_json(state["config"]) != config or state["seed"] != seed:
        raise ConfigError(
            "The checkpoints of this run come from another Phase II configuration or seed; "
            "use the same options, or remove the run's checkpoints to start anew."
        )
    for name, parameter in network.named_parameters():
        with torch.no_grad():
            parameter.copy_(tensors[f"network.{name}"])
        moments = {moment: tensors[f"{moment}.{name}"].to(parameter.device) for moment in _MOMENTS}
        optimizer.state[parameter] = {"step": torch.tensor(float(step)), **moments}
    return step

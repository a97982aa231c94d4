"""Training of the illumination MLP: one photo a step, its probes stacked to a map that is compared with its
light.
"""

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from lightprobe.core.config.distillation import DistillConfig, RadianceUnit
from lightprobe.distillation.loss import intensity_weight, sample_weight, weighted_l2
from lightprobe.distillation.network_task import NetworkTask, mixed_precision
from lightprobe.lessons.lesson import Lesson
from lightprobe.light import cubemap
from lightprobe.models.illumination_mlp import IlluminationMlp
from lightprobe.models.probe_distribution import stack
from lightprobe.models.probe_pixels import ProbePixels
from lightprobe.models.sampling import sample_pixels
from lightprobe.training.loop import visited


class MlpTask(NetworkTask):
    """The illumination MLP and the photos it learns from."""

    def __init__(
        self,
        network: IlluminationMlp,
        lessons: Sequence[Lesson],
        config: DistillConfig,
        seed: int,
    ):
        super().__init__(network, "network", config.learning_rate)
        device = lessons[0].teacher.device
        self._lessons, self._config, self._seed = lessons, config, seed
        self._forward = mixed_precision(network, device)
        self._directions = cubemap.directions(config.light_resolution, device).reshape(-1, 3)
        self._solid_angles = cubemap.solid_angles(config.light_resolution).to(device).reshape(-1)
        if not config.solid_angle_weight:
            self._solid_angles = torch.full_like(self._solid_angles, 4 * math.pi / len(self._solid_angles))

    def given(self, iteration: int) -> tuple[Tensor, ...]:
        """Return what the loss of a step needs of its photo, as `lesson_tensors`."""
        lesson = lesson_of(self._lessons, self._seed, iteration)
        return lesson_tensors(lesson, self._config, self._seed, iteration)

    def loss(self, iteration: int, fraction: float, *given: Tensor) -> Tensor:
        """Return the `lesson_loss` () of the photo `given`."""
        return lesson_loss(self._forward, given, self._directions, self._solid_angles, self._config)

    def photos(self, iteration: int) -> str:
        """Return the name of the photo of a step, in quotes."""
        return f"'{lesson_of(self._lessons, self._seed, iteration).name}'"


def lesson_tensors(lesson: Lesson, config: DistillConfig, seed: int, step: int) -> tuple[Tensor, ...]:
    """Return what `lesson_loss` needs of one photo: the fields of the pixels drawn for `step`, as in
    `ProbePixels`, then the light level (), the distribution of all pixels (M,) and the teacher (M, 3).
    """
    chosen = sample_pixels(
        lesson.pixels.roughness, config.samples, seed=seed, stream="distill-pixels", step=step
    )
    return (*lesson.pixels.take(chosen).tensors(), lesson.light_level, lesson.distribution, lesson.teacher)


def lesson_loss(
    network: Callable[[ProbePixels, Tensor], Tensor],
    given: Sequence[Tensor],
    directions: Tensor,
    solid_angles: Tensor,
    config: DistillConfig,
) -> Tensor:
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


def lesson_of(lessons: Sequence[Lesson], seed: int, step: int) -> Lesson:
    """Return the photo of `step`: every photo once per epoch, in an order of the epoch's own."""
    return lessons[visited(seed, "distill-photo", len(lessons), step)]

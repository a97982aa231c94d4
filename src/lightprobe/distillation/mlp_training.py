"""Training of the illumination MLP: one photo a step, its probes stacked to a map compared with its light."""

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from lightprobe.core.config.distillation import DistillConfig, RadianceUnit
from lightprobe.distillation.examples import TrainingExample
from lightprobe.distillation.loss import intensity_weight, sample_weight, weighted_l2
from lightprobe.distillation.network_objective import NetworkObjective, mixed_precision
from lightprobe.light import cubemap
from lightprobe.models.illumination_mlp import IlluminationMlp
from lightprobe.models.probe_distribution import stack
from lightprobe.models.probe_pixels import ProbePixels, sample_pixels
from lightprobe.training.loop import visited

_RATE = 5e-4  # Adam step (paper, 4.2)


class MlpObjective(NetworkObjective):
    """The illumination MLP and the photos it learns from."""

    def __init__(
        self, network: IlluminationMlp, examples: Sequence[TrainingExample], config: DistillConfig, seed: int
    ):
        super().__init__(network, "network", _RATE)
        device = examples[0].target.device
        self._lessons, self._config, self._seed = examples, config, seed
        self._forward = mixed_precision(network, device)
        self._directions = cubemap.directions(config.light_resolution, device).reshape(-1, 3)
        self._solid_angles = cubemap.solid_angles(config.light_resolution).to(device).reshape(-1)
        if not config.solid_angle_weight:
            self._solid_angles = torch.full_like(self._solid_angles, 4 * math.pi / len(self._solid_angles))

    def given(self, iteration: int) -> tuple[Tensor, ...]:
        """Return what the loss of a step needs of its photo, as `example_tensors`."""
        example = example_of(self._lessons, self._seed, iteration)
        return example_tensors(example, self._config, self._seed, iteration)

    def loss(self, iteration: int, fraction: float, *given: Tensor) -> Tensor:
        """Return the `example_loss` () of the photo `given`."""
        return example_loss(self._forward, given, self._directions, self._solid_angles, self._config)

    def photos(self, iteration: int) -> str:
        """Return the name of the photo of a step, in quotes."""
        return f"'{example_of(self._lessons, self._seed, iteration).name}'"


def example_tensors(
    example: TrainingExample, config: DistillConfig, seed: int, step: int
) -> tuple[Tensor, ...]:
    """Return what `example_loss` needs of one photo.

    The fields of the pixels drawn for `step`, as in `ProbePixels`, then the light level (), the distribution
    of all pixels (M,) and the light to predict (M, 3).
    """
    roughness = example.pixels.roughness
    chosen = sample_pixels(roughness, config.samples, seed=seed, stream="distill-pixels", step=step)
    return (*example.pixels.take(chosen).tensors(), example.light_level, example.distribution, example.target)


def example_loss(
    network: Callable[[ProbePixels, Tensor], Tensor],
    given: Sequence[Tensor],
    directions: Tensor,
    solid_angles: Tensor,
    config: DistillConfig,
) -> Tensor:
    """Return Equation 6 () of the illumination MLP for one photo, `given` as `example_tensors`."""
    *fields, light_level, distribution, target = given
    pixels = ProbePixels(*fields)
    colors = network(pixels, light_level)
    if config.radiance_unit is RadianceUnit.LEVEL:
        colors = colors / light_level
    else:
        target = target * light_level
    predicted, sampled = stack(pixels, colors, directions, config.alpha_rule)
    weight = sample_weight(sampled, distribution) * intensity_weight(target, config.radiance_unit)
    return weighted_l2(predicted, target, weight, solid_angles, config.loss_space)


def example_of(examples: Sequence[TrainingExample], seed: int, step: int) -> TrainingExample:
    """Return the photo of `step`: every photo once per epoch, in an order of the epoch's own."""
    return examples[visited(seed, "distill-photo", len(examples), step)]

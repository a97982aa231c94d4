"""Training of the sphere network on training examples turned into maps.

Notation: E, P true and predicted light relative to the light level, (B, 3, 1536) texels; g(x) = log(x + e).

    loss = mean |g(E) - g(P)|^2  +  sum_k mean |log(K_k E + e) - log(K_k P + e)|^2

K_k are averages over lobes of two widths, a cosine and one of about 20 degrees. The first term alone would
predict the typical log radiance of each texel, and with it too dim a lamp wherever its place is uncertain;
the others ask for the light that matte and satin surfaces would receive. Directions count by solid angle.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.device import generator, to_device
from lightprobe.distillation.examples import TrainingExample
from lightprobe.distillation.network_objective import NetworkObjective, mixed_precision
from lightprobe.light import cubemap
from lightprobe.light.resize import magnify_light, resize_light
from lightprobe.models.illumination_mlp import IlluminationMlp
from lightprobe.models.probe_maps import BLACK, RESOLUTION, probe_maps, turned
from lightprobe.models.probe_model import starts_pretrained
from lightprobe.models.probe_pixels import sample_pixels
from lightprobe.models.sphere_net import SphereNet
from lightprobe.training.descent import Schedule

_WARM_UP = 50  # steps
_BATCH = 8  # photos in a step
_RATE, _RATE_FROM_NOISE = 5e-4, 2e-3  # largest Adam step from the bundled weights, and from random ones
_SATIN = 0.06  # exponential width in 1 - cosine


class SphereObjective(NetworkObjective):
    """The sphere network and the examples it learns from."""

    def __init__(self, sphere: SphereNet, examples: "SphereExamples", config: DistillConfig, seed: int):
        super().__init__(sphere, "sphere", _RATE if starts_pretrained(config) else _RATE_FROM_NOISE)
        self._examples, self._seed = examples, seed
        self._forward = mixed_precision(sphere, examples.maps.device)

    def given(self, iteration: int) -> tuple[Tensor, ...]:
        """Return the maps and lights of a step, as `batch`."""
        return batch(self._examples, self._seed, iteration)

    def loss(self, iteration: int, fraction: float, *given: Tensor) -> Tensor:
        """Return the `sphere_loss` () of the batch `given`."""
        maps, lights = given
        return sphere_loss(self._forward(maps), lights)

    def photos(self, iteration: int) -> str:
        """Return the words for a batch, in which many photos take part."""
        return "several"


@dataclass(frozen=True)
class SphereExamples:
    """All examples as the sphere network sees them."""

    maps: Tensor  # (L, 19, 6, 16, 16)
    lights: Tensor  # (L, 3, 1536) relative radiance


@torch.no_grad()
def sphere_examples(
    network: IlluminationMlp, examples: Sequence[TrainingExample], config: DistillConfig, seed: int
) -> SphereExamples:
    """Return the maps of all examples, from as many pixels as the MLP's training steps take."""
    maps, lights = [], []
    for number, example in enumerate(examples):
        roughness = example.pixels.roughness
        chosen = sample_pixels(roughness, config.samples, seed=seed, stream="album-pixels", step=number)
        pixels = example.pixels.take(chosen)
        colors = network(pixels, example.light_level)
        clipped = example.clipped[chosen]
        level, solved = example.light_level, example.solved
        maps.append(probe_maps(pixels, colors, clipped, level, solved, example.up, config.alpha_rule))
        lights.append(_at_resolution(example.target).reshape(-1, 3).T)
    return SphereExamples(torch.stack(maps), torch.stack(lights).contiguous())


def sphere_loss(log_light: Tensor, lights: Tensor) -> Tensor:
    """Return the loss () of the network's output (B, 3, 6, 16, 16) against relative lights (B, 3, 1536)."""
    log_light = log_light.flatten(2)
    loss = ((log_light - (lights + BLACK).log()).square() * _shares(lights.device)).sum(-1).mean()
    light = (log_light.clamp(max=12.0).exp() - BLACK).clamp(min=0)
    for lobe in _lobes(lights.device):
        difference = (light @ lobe + BLACK).log() - (lights @ lobe + BLACK).log()
        loss = loss + difference.square().mean()
    return loss


def batch(examples: SphereExamples, seed: int, step: int) -> tuple[Tensor, Tensor]:
    """Return the maps (B, 19, 6, 16, 16) and lights (B, 3, 1536) of the examples of `step`.

    They are drawn at random, and each is turned or mirrored at random: light that falls on a turned object
    from a turned sphere teaches the same once more, and costs no rendering.
    """
    random, device = generator(seed, "sphere-batch", step), examples.maps.device
    symmetries, _ = cubemap.symmetries(RESOLUTION, device)
    chosen, turn = (
        to_device(torch.randint(len(of), (_BATCH,), generator=random), device)
        for of in (examples.maps, symmetries)
    )
    lights = examples.lights[chosen]
    return turned(examples.maps[chosen], turn), lights.gather(2, symmetries[turn][:, None].expand_as(lights))


def schedule(config: DistillConfig) -> Schedule:
    """Return how the learning rate goes: a short warm-up, then down along a cosine."""

    def rate_at(rate: float, step: int) -> float:
        warm = min(1.0, (step + 1) / _WARM_UP)
        return rate * warm * 0.5 * (1 + math.cos(math.pi * step / config.sphere_steps))

    return rate_at


@functools.lru_cache(maxsize=4)
def _shares(device: torch.device) -> Tensor:
    """Return the texels' shares of the sphere, (1536,)."""
    return cubemap.solid_angles(RESOLUTION, device).reshape(-1) / (4 * math.pi)


@functools.lru_cache(maxsize=4)
def _lobes(device: torch.device) -> tuple[Tensor, ...]:
    """Return averaging matrices (1536, 384): under a cosine and a satin lobe around 6 x 8 x 8 directions."""
    texels = cubemap.directions(RESOLUTION, device).reshape(-1, 3)
    cosine = texels @ cubemap.directions(RESOLUTION // 2, device).reshape(-1, 3).T
    angle = cubemap.solid_angles(RESOLUTION, device).reshape(-1, 1)
    lobes = (cosine.clamp(min=0) * angle, torch.exp((cosine - 1) / _SATIN) * angle)
    return tuple(lobe / lobe.sum(0) for lobe in lobes)


def _at_resolution(light: Tensor) -> Tensor:
    """Return relative radiance (M, 3) on a cubemap of any resolution as (6, 16, 16, 3)."""
    side = math.isqrt(len(light) // 6)
    light = light.reshape(6, side, side, 3)
    return resize_light(light, RESOLUTION) if side >= RESOLUTION else magnify_light(light, RESOLUTION)

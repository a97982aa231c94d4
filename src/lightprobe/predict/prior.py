"""First guesses of a photo's light, and how much of each direction the photo saw.

Notation: W(w) = mean_p D_p(w) the mean distribution of the sampled pixels (1/sr), Wbar its mean over the sphere, s the
photo's light level, P the stacked probes (Equation 5), E_m the training photos' mean light relative to their levels.
"""

import math

import torch
from torch import Tensor

from lightprobe.core.config_distill import AlphaRule
from lightprobe.distill.probe_distribution import stack_everywhere
from lightprobe.distill.probe_model import ProbeModel
from lightprobe.distill.probe_pixels import ProbePixels
from lightprobe.distill.sampling import sample_pixels
from lightprobe.light import cubemap
from lightprobe.light.resize import resize_light
from lightprobe.predict.observation import Observation

_USUAL_SHARE = 0.02


def sampled_probes(observation: Observation, seed: int) -> ProbePixels:
    """Return a quarter of the trusted pixels, smooth ones preferred (section 3.2.3), in the photo's order."""
    quarter = -(-len(observation.pixels) // 4)
    chosen = sample_pixels(observation.pixels.roughness, quarter, seed=seed, stream="predict-pixels")
    return observation.pixels.take(chosen.sort().values)


def constant_light(observation: Observation, resolution: int) -> Tensor:
    """Return the grey map (6, R, R, 3) at the photo's light level."""
    return observation.light_level.expand(6, resolution, resolution, 3).contiguous()


def stacked_light(
    model: ProbeModel, colors: Tensor, probes: ProbePixels, light_level: Tensor, resolution: int
) -> tuple[Tensor, Tensor]:
    """Return the map (6, R, R, 3) of the network's probe `colors` (N, 3), and W (6, R, R).

    Directions at which hardly a pixel looks take over the light that is usual there:
    E = (W P + e Wbar s E_m) / (W + e Wbar), e = 0.02.
    """
    stacked, weight = stack_everywhere(probes, colors, resolution, model.config.alpha_rule)
    usual = light_level * resize_light(model.mean_light, resolution)
    share = (_USUAL_SHARE * _sphere_mean(weight)).clamp_min(1e-12)
    seen = weight[..., None]
    return (seen * stacked + share * usual) / (seen + share), weight


def coverage(probes: ProbePixels, resolution: int) -> Tensor:
    """Return W (6, R, R) of pixels, with the renderer's own lobes."""
    return stack_everywhere(probes, torch.zeros_like(probes.color), resolution, AlphaRule.R4)[1]


def _sphere_mean(weight: Tensor) -> Tensor:
    angle = cubemap.solid_angles(weight.shape[1], weight.device)
    return (weight * angle).sum() / (4 * math.pi)

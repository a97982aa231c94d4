"""First guesses of a photo's light.

Notation: W(w) = mean_p D_p(w) the mean distribution of the sampled pixels (1/sr), Wbar its mean over the
sphere, s the photo's light level, P the stacked probes (Equation 5), E_m the mean light of the training
examples relative to their levels.
"""

import math

from torch import Tensor

from lightprobe.core.config.prediction import PredictConfig
from lightprobe.core.errors import ConfigError
from lightprobe.light import cubemap
from lightprobe.light.resize import magnify_light
from lightprobe.models.probe_distribution import stack_everywhere
from lightprobe.models.probe_maps import SOLVED_PIXELS, coarse_lights, probe_maps
from lightprobe.models.probe_model import ProbeModel
from lightprobe.models.probe_pixels import ProbePixels, sample_pixels
from lightprobe.models.sphere_net import light_of, mean_over_turns
from lightprobe.prediction.observation import Observation
from lightprobe.render.coarse_transport import CoarseTransport

_TURNS = 6  # of the maps that the network answers; the mean of 24 is no better
_HUE_KEPT = 0.25  # share of a hue's distance from the mean; docs/decisions/refinement-colour-and-means.md
_HUE_DARK = 0.01  # relative to the light level: darker has no hue


def sampled_probes(observation: Observation, share: float, seed: int) -> Tensor:
    """Return ordered indices (N,) of a share of the trusted pixels, mostly smooth ones (section 3.2.3)."""
    count = math.ceil(share * len(observation.pixels))
    chosen = sample_pixels(observation.pixels.roughness, count, seed=seed, stream="predict-pixels")
    return chosen.sort().values


def constant_light(observation: Observation, resolution: int) -> Tensor:
    """Return the grey map (6, R, R, 3) at the photo's light level."""
    return observation.light_level.expand(6, resolution, resolution, 3).contiguous()


def stacked_light(
    model: ProbeModel, colors: Tensor, probes: ProbePixels, light_level: Tensor, config: PredictConfig
) -> Tensor:
    """Return the map (6, R, R, 3) of the network's probe `colors` (N, 3).

    Directions at which hardly a pixel looks take over the light that is usual there:
    E = (W P + e Wbar s E_m) / (W + e Wbar), e = `unseen_share`; with e = 0 the map is P (the paper).
    """
    stacked, weight = stack_everywhere(probes, colors, config.light_resolution, model.config.alpha_rule)
    if config.unseen_share == 0:
        return stacked
    usual = light_level * model.mean_light.resized(config.light_resolution).texels
    share = (config.unseen_share * cubemap.sphere_mean(weight)).clamp_min(1e-12)
    seen = weight[..., None]
    return (seen * stacked + share * usual) / (seen + share)


def network_light(
    model: ProbeModel,
    observation: Observation,
    probes: ProbePixels,
    chosen: Tensor,
    resolution: int,
    seed: int,
) -> Tensor:
    """Return the sphere network's map (6, R, R, 3) from `probes`, the observation's `chosen` pixels.

    Raises `ConfigError` when the model was trained without that network.
    """
    if model.sphere is None:
        raise ConfigError(
            "This run was trained without the sphere network; distill it again with --distill.sphere-steps above 0."
        )
    level, seen = observation.light_level, observation.pixels
    some = observation.drawn(SOLVED_PIXELS, seed, "subset/coarse-light")
    transport = CoarseTransport.of(observation.gbuffer.select(observation.rows[some]))
    solved = coarse_lights(transport, seen.color[some], level)
    colors = model.network(probes, level)
    clipped = observation.clipped[chosen]
    maps = probe_maps(probes, colors, clipped, level, solved, model.up, model.config.alpha_rule)
    predicted = mean_over_turns(model.sphere, maps[None], _TURNS)[0]
    log_light = magnify_light(predicted.permute(1, 2, 3, 0).contiguous(), resolution)
    return light_of(log_light.permute(3, 0, 1, 2), level)


def desaturated(light: Tensor, light_level: Tensor) -> Tensor:
    """Return a map (6, R, R, 3) as bright, its hues at a quarter of their distance from the mean hue.

    Which directions are bright, a network knows better than of what colour each is: lights are mostly greyer
    than the surfaces they are read from. What the photo says about colour, a fit adds.
    """
    dark = _HUE_DARK * light_level
    log = (light + dark).log()
    brightness = log.mean(-1, keepdim=True)
    hue = log - brightness
    weight = brightness.exp() * cubemap.solid_angles(light.shape[1], light.device)[..., None]
    mean = (hue * weight).sum((0, 1, 2)) / weight.sum()
    return ((brightness + mean + _HUE_KEPT * (hue - mean)).exp() - dark).clamp(min=0)

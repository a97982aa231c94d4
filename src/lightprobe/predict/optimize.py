"""The baseline that takes minutes: gradient descent on every texel of the light, for one photo.

    minimise  mean_p |t(A E) - t(I)|  +  grey |E - grey(E)|,   E = exp(x),   by Adam on x

This is how inverse renderers without a predictor find the light of a new photo, with the loss of Phase I: t(x) =
sRGB(log(1 + x)), absolute differences, one-sided where the photo is clipped. It starts at the constant light.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from lightprobe.core.device import draw_rows, generator
from lightprobe.core.errors import ConfigError
from lightprobe.imaging import srgb_encode
from lightprobe.light import prefilter as prefilters
from lightprobe.light.resize import magnify_light, resize_light
from lightprobe.predict.observation import Observation
from lightprobe.render.transport import Transport

_REFINED_RESOLUTION = 16
_DARK = 1e-4  # relative to the light level
_USUAL_MEAN = 0.22  # linear mean of a well-exposed object: the loss is taken as if the photo were exposed so


@dataclass(frozen=True)
class OptimizeConfig:
    """Cost and steps of the optimisation."""

    iterations: int = 1500
    """Adam steps, each on all pixels."""
    learning_rate: float = 0.05
    """Adam step in log radiance at the start; it falls to nothing along a cosine."""
    pixels: int = 12_288
    """Pixels the light is fitted to."""
    grey: float = 0.005
    """Weight of the mean deviation of the light from grey."""

    def __post_init__(self) -> None:
        """Refuse values no optimisation could use."""
        if self.iterations < 1 or self.pixels < 1 or not self.learning_rate > 0 or self.grey < 0:
            raise ConfigError("An optimisation needs iterations and pixels of at least 1 and positive weights.")


def brief() -> OptimizeConfig:
    """Return a fraction of a second of it, for where a network has gone most of the way."""
    return OptimizeConfig(iterations=60, learning_rate=0.1, pixels=3072)


class _Render(torch.autograd.Function):
    """A E, whose gradient is the adjoint."""

    @staticmethod
    def forward(ctx: Any, light: Tensor, transport: Transport) -> Tensor:
        ctx.transport = transport
        return transport.apply(light)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return ctx.transport.adjoint(gradient), None


def optimize_environment(observation: Observation, start: Tensor, config: OptimizeConfig, seed: int) -> Tensor:
    """Return the light (6, R, R, 3) > 0 found from `start` (6, R, R, 3)."""
    every = torch.arange(len(observation.rows), device=start.device)
    chosen = draw_rows(every, config.pixels, generator(seed, "subset/optimize"))
    operator = prefilters.cached(start.shape[1], start.device)
    transport = Transport(observation.gbuffer, operator, observation.rows[chosen])
    color, clipped = observation.pixels.color[chosen], observation.clipped[chosen]
    unit = color.mean().clamp(min=1e-9) / _USUAL_MEAN
    target = _displayed(color / unit)
    logarithm = (start / unit).clamp(min=1e-4).log().requires_grad_(True)
    optimizer = torch.optim.Adam([logarithm], lr=config.learning_rate)
    for step in range(config.iterations):
        optimizer.param_groups[0]["lr"] = (
            0.5 * config.learning_rate * (1 + math.cos(math.pi * step / config.iterations))
        )
        with torch.enable_grad():
            light = logarithm.exp()
            difference = _displayed(_Render.apply(light, transport)) - target
            difference = torch.where(clipped, difference.clamp(max=0), difference)
            chroma = (light - light.mean(-1, keepdim=True)).abs().mean()
            loss = difference.abs().mean() + config.grey * chroma
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
    return unit * logarithm.detach().exp()


def refine_environment(observation: Observation, prior: Tensor, config: OptimizeConfig, seed: int) -> Tensor:
    """Return `prior` (6, R, R, 3) times what a short optimisation on at most 6 x 16 x 16 texels makes of it.

    Few steps in log radiance are a regulariser of their own: every texel may change by a bounded factor, those that
    the photo insists on go first, and absolute displayed errors keep a wrong spot of the asset from being explained by
    the light. Details finer than the texels stay those of the prior.
    """
    coarse = resize_light(prior, min(_REFINED_RESOLUTION, prior.shape[1]))
    dark = _DARK * observation.light_level
    factor = (optimize_environment(observation, coarse, config, seed) + dark) / (coarse + dark)
    return prior * magnify_light(factor.log(), prior.shape[1]).exp()


def _displayed(color: Tensor) -> Tensor:
    """Return sRGB(log(1 + x)) of linear colours."""
    return srgb_encode(torch.log1p(color.clamp(min=0)))

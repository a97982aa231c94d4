"""Gradient descent on the light of one photo: the baseline that takes minutes, and what refines a prediction.

    minimise  mean_p |t(A E) - t(I)|  +  grey |E - grey(E)|,   E = exp(x),   by Adam on x

This is how inverse renderers without a predictor find the light of a new photo, with the loss of Phase I:
t(x) = sRGB(log(1 + x)), absolute differences, one-sided where the photo is clipped. The baseline descends on
every texel and starts at the constant light.

The refinement takes few steps from a map that is nearly right. There it matters which texels move: Adam
divides each gradient by its own size, so that a direction the photo hardly depends on, moved by the asset's
errors, moves as fast as one that the photo insists on. So the size is damped, g / (|g| + damping RMS(g)),
with the root mean square over all texels at the first step; and x is the sum of single texels, a smooth part
and a broad one. The smooth ones move faster; the broad one, which all pixels have a say in, is damped less,
as few steps would not bring it to where the photo wants it.

A step of the refinement looks at a twelfth of the pixels, and the next one at others. What Adam averages over
a dozen steps then has seen all of them, and the map is as good as with all pixels in every step.
"""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from lightprobe.core.config.prediction import OptimizeConfig
from lightprobe.light import prefilter as prefilters
from lightprobe.light.photometry import exposure_unit, one_sided_residual, tone_map
from lightprobe.light.prefilter import BLOCKS, DRAFT, Accuracy
from lightprobe.light.resize import magnify_light, resize_light
from lightprobe.prediction.observation import Observation
from lightprobe.render.transport import Transport
from lightprobe.training.adam import ParameterGroup
from lightprobe.training.descent import Descent, cosine

_REFINED_RESOLUTION = 32  # texels along an edge at most, for time
_BROAD = 2  # texels along each edge
_DARK = 1e-4  # relative to the light level


class _Render(torch.autograd.Function):
    """A E, whose gradient is the adjoint."""

    @staticmethod
    def forward(ctx: Any, light: Tensor, transport: Transport) -> Tensor:
        ctx.transport = transport
        return transport.apply(light)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return ctx.transport.adjoint(gradient), None


@dataclass(frozen=True)
class _Pixels:
    """The pixels that a light is fitted to, at a usual exposure."""

    transport: Transport
    target: Tensor  # (P, 3) tone-mapped
    clipped: Tensor  # (P, 3) bool

    @staticmethod
    def of(
        observation: Observation, resolution: int, count: int, seed: int, accuracy: Accuracy | None
    ) -> "tuple[_Pixels, Tensor]":
        """Return at most `count` of the trusted pixels, and what their radiance is divided by ()."""
        chosen = observation.drawn(count, seed, "subset/optimize")
        color = observation.pixels.color[chosen]
        unit = exposure_unit(color)  # the loss is taken as if the photo were well exposed
        operator = prefilters.cached(resolution, color.device, accuracy)
        transport = Transport(observation.gbuffer, operator, observation.rows[chosen])
        return _Pixels(transport, tone_map(color / unit), observation.clipped[chosen]), unit

    def select(self, rows: Tensor) -> "_Pixels":
        """Return the pixels at `rows` (K,) int64."""
        return _Pixels(self.transport.select(rows), self.target[rows], self.clipped[rows])

    def error(self, light: Tensor) -> Tensor:
        """Return the mean displayed error () under `light` (6, R, R, 3)."""
        render = _Render.apply(light, self.transport)
        return one_sided_residual(tone_map(render), self.target, self.clipped).abs().mean()


def optimize_environment(
    observation: Observation,
    start: Tensor,
    config: OptimizeConfig,
    seed: int,
    accuracy: Accuracy | None = None,
) -> Tensor:
    """Return the light (6, R, R, 3) > 0 found from `start` (6, R, R, 3).

    accuracy: of the prefilter, by default what lights of this resolution deserve.
    """
    pixels, unit = _Pixels.of(observation, start.shape[1], config.pixels, seed, accuracy)
    first = (start / unit).clamp(min=1e-4).log()
    groups = _groups(start, config)
    changes = [change for group in groups for change in group.parameters.values()]

    def light() -> Tensor:
        change = changes[0]
        for finer in changes[1:]:
            change = magnify_light(change, finer.shape[1]) + finer
        return (first + change).exp()

    def loss(part: _Pixels | Tensor) -> Tensor:
        sought = light()
        chroma = (sought - sought.mean(-1, keepdim=True)).abs().mean()
        seen = pixels.select(part) if isinstance(part, Tensor) else part
        return seen.error(sought) + config.grey * chroma

    descent = Descent(groups, loss, schedule=cosine(config.iterations), fused=True, recordable=True)
    batches = _batches(len(pixels.target), config.batch, start.device)
    parts = batches if descent.recorded else [pixels.select(rows) for rows in batches]
    for step in range(config.iterations):
        descent.step(step, parts[step % len(parts)])
    descent.end()
    return unit * light().detach()


def _batches(count: int, size: int, device: torch.device) -> list[Tensor]:
    """Return the rows (K,) int64 of equal batches of about `size` of `count` pixels; of all if `size` is 0.

    Pixels come in the order of the photo's rows: taking every n-th spreads each batch over the whole object.
    """
    number = max(1, round(count / size)) if size else 1
    return list(torch.arange(count // number * number, device=device).reshape(-1, number).T)


def _groups(start: Tensor, config: OptimizeConfig) -> list[ParameterGroup]:
    """Return the moving parts of the change of log radiance, from the broadest to the texels of `start`."""
    sizes = {
        "broad": (_BROAD, config.smooth_learning_rate, config.broad_damping),
        "smooth": (BLOCKS, config.smooth_learning_rate, config.damping),
        "texels": (start.shape[1], config.learning_rate, config.damping),
    }

    def zeros(side: int) -> Tensor:
        return torch.zeros(6, side, side, 3, device=start.device, requires_grad=True)

    moving = ((name, *values) for name, values in sizes.items() if values[1] > 0)
    return [ParameterGroup({name: zeros(side)}, rate, damping) for name, side, rate, damping in moving]


def refine_environment(observation: Observation, prior: Tensor, config: OptimizeConfig, seed: int) -> Tensor:
    """Return `prior` (6, R, R, 3) times the factor of a short optimisation on at most 6 x 32 x 32 texels.

    Few steps in log radiance are a regulariser of their own: every texel may change by a bounded factor,
    those that the photo insists on go first, and absolute displayed errors keep a wrong spot of the asset
    from being explained by the light. Details finer than the texels stay those of the prior.
    """
    coarse = resize_light(prior, min(_REFINED_RESOLUTION, prior.shape[1]))
    dark = _DARK * observation.light_level
    factor = (optimize_environment(observation, coarse, config, seed, DRAFT) + dark) / (coarse + dark)
    return prior * magnify_light(factor.log(), prior.shape[1]).exp()

"""Gradient descent on the light of one photo: the baseline that takes minutes, and what refines a prediction.

    minimise  mean_p |t(A E) - t(I)|  +  grey |E - grey(E)|,   E = exp(x),   by Adam on x

This is how inverse renderers without a predictor find the light of a new photo, with the loss of Phase I: t(x) =
sRGB(log(1 + x)), absolute differences, one-sided where the photo is clipped. The baseline descends on every texel and
starts at the constant light.

The refinement takes few steps from a map that is nearly right. There it matters which texels move: Adam divides each
gradient by its own size, so that a direction the photo hardly depends on moves as fast as one it insists on, and what
moves it is the asset's errors. So the size is damped, g / (|g| + damping RMS(g)), with the root mean square over all
texels at the first step; and x is the sum of single texels, a smooth part and a broad one. The smooth ones move faster,
and the broad one, which all pixels have a say in, is damped less: few steps would not bring it to where the photo
wants it.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.optim.adam import adam

from lightprobe.core.device import draw_rows, generator
from lightprobe.core.errors import ConfigError
from lightprobe.core.recording import Recorded, recorder_for
from lightprobe.imaging.photometry import exposure_unit, one_sided_residual, tone_map
from lightprobe.light import prefilter as prefilters
from lightprobe.light.prefilter import BLOCKS
from lightprobe.light.resize import magnify_light, resize_light
from lightprobe.prediction.observation import Observation
from lightprobe.render.transport import Transport

_REFINED_RESOLUTION = 32
_BROAD = 2  # texels along each edge
_DARK = 1e-4  # relative to the light level
_LEAST_EPS = 1e-8  # Adam's own
_BETAS = 0.9, 0.999  # Adam's own


@dataclass(frozen=True)
class OptimizeConfig:
    """Cost and steps of the optimisation."""

    iterations: int = 1500
    """Adam steps, each on all pixels."""
    learning_rate: float = 0.05
    """Adam step in log radiance at the start; it falls to nothing along a cosine."""
    smooth_learning_rate: float = 0.0
    """The same of the smooth and the broad part of the change, on 6 x 8 x 8 and 6 x 2 x 2 texels."""
    damping: float = 0.0
    """How large a gradient, relative to the usual one, makes half a step."""
    broad_damping: float = 0.0
    """The same of the broad part."""
    pixels: int = 12_288
    """Pixels the light is fitted to."""
    grey: float = 0.005
    """Weight of the mean deviation of the light from grey."""

    def __post_init__(self) -> None:
        """Refuse values no optimisation could use."""
        if self.iterations < 1 or self.pixels < 1 or not self.learning_rate > 0:
            raise ConfigError("An optimisation needs iterations and pixels of at least 1 and a positive step.")
        if min(self.smooth_learning_rate, self.damping, self.broad_damping, self.grey) < 0:
            raise ConfigError("An optimisation needs weights of at least 0.")


def brief() -> OptimizeConfig:
    """Return a fraction of a second of it, for where a network has gone most of the way."""
    return OptimizeConfig(
        iterations=60, learning_rate=0.1, smooth_learning_rate=0.2, damping=0.3, broad_damping=0.1, pixels=3072
    )  # fmt: skip


class _Render(torch.autograd.Function):
    """A E, whose gradient is the adjoint."""

    @staticmethod
    def forward(ctx: Any, light: Tensor, transport: Transport) -> Tensor:
        ctx.transport = transport
        return transport.apply(light)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return ctx.transport.adjoint(gradient), None


@dataclass
class _Part:
    """A part of the change of the log radiance, and Adam's memory of it.

    The update is PyTorch's function and not its class, as the first use of any `torch.optim.Optimizer` imports the
    compiler of PyTorch: two seconds, of which a prediction in a new process would be the longest part.
    """

    change: Tensor  # (6, n, n, 3), requires grad
    rate: float
    damping: float
    mean: Tensor  # of the gradient, as change
    square: Tensor  # mean of its square
    steps: Tensor  # () float32
    recorded: bool
    eps: float | None = None  # found in the first step

    @staticmethod
    def still(side: int, rate: float, damping: float, device: torch.device, *, recorded: bool) -> "_Part":
        """Return no change yet on 6 x side x side texels."""
        change = torch.zeros(6, side, side, 3, device=device, requires_grad=True)
        steps = torch.zeros((), device=device if recorded else None)
        return _Part(change, rate, damping, torch.zeros_like(change), torch.zeros_like(change), steps, recorded)

    @torch.no_grad()
    def step(self, gradient: Tensor, share: Tensor) -> None:
        """Take one step of Adam, of `share` () of the rate."""
        if self.eps is None:
            self.eps = max(self.damping * float(gradient.square().mean().sqrt()), _LEAST_EPS)
        rate = share * self.rate
        adam(
            [self.change], [gradient.contiguous()], [self.mean], [self.square], [], [self.steps],
            amsgrad=False, beta1=_BETAS[0], beta2=_BETAS[1], lr=rate if self.recorded else float(rate),
            weight_decay=0.0, eps=self.eps, maximize=False, fused=self.recorded, capturable=self.recorded,
        )  # fmt: skip


def optimize_environment(observation: Observation, start: Tensor, config: OptimizeConfig, seed: int) -> Tensor:
    """Return the light (6, R, R, 3) > 0 found from `start` (6, R, R, 3)."""
    every = torch.arange(len(observation.rows), device=start.device)
    chosen = draw_rows(every, config.pixels, generator(seed, "subset/optimize"))
    operator = prefilters.cached(start.shape[1], start.device)
    transport = Transport(observation.gbuffer, operator, observation.rows[chosen])
    color, clipped = observation.pixels.color[chosen], observation.clipped[chosen]
    unit = exposure_unit(color)  # the loss is taken as if the photo were well exposed
    target = tone_map(color / unit)
    first = (start / unit).clamp(min=1e-4).log()
    recorder = recorder_for(start.device)
    parts = _parts(start, config, recorded=recorder is not None)
    changes = [part.change for part in parts]

    def light() -> Tensor:
        change = changes[0]
        for finer in changes[1:]:
            change = magnify_light(change, finer.shape[1]) + finer
        return (first + change).exp()

    def descend(share: Tensor) -> Tensor:
        with torch.enable_grad():
            sought = light()
            difference = one_sided_residual(tone_map(_Render.apply(sought, transport)), target, clipped)
            chroma = (sought - sought.mean(-1, keepdim=True)).abs().mean()
            loss = difference.abs().mean() + config.grey * chroma
        for part, gradient in zip(parts, torch.autograd.grad(loss, changes), strict=True):
            part.step(gradient, share)
        return loss.detach()

    step = Recorded(descend, recorder)
    for share in _shares(config.iterations, None if recorder is None else start.device):
        step(share)
    return unit * light().detach()


def _shares(steps: int, device: torch.device | None) -> Tensor:
    """Return what remains of the rates at each step, along a cosine: (steps,), what Adam takes on that device."""
    shares = torch.tensor([0.5 * (1 + math.cos(math.pi * step / steps)) for step in range(steps)], dtype=torch.float64)
    return shares if device is None else shares.to(device, torch.float32)


def _parts(start: Tensor, config: OptimizeConfig, *, recorded: bool) -> list[_Part]:
    """Return the parts of the change that move at all, from the broadest to the texels of `start`."""
    sizes = (
        (_BROAD, config.smooth_learning_rate, config.broad_damping),
        (BLOCKS, config.smooth_learning_rate, config.damping),
        (start.shape[1], config.learning_rate, config.damping),
    )
    return [
        _Part.still(side, rate, damping, start.device, recorded=recorded) for side, rate, damping in sizes if rate > 0
    ]


def refine_environment(observation: Observation, prior: Tensor, config: OptimizeConfig, seed: int) -> Tensor:
    """Return `prior` (6, R, R, 3) times what a short optimisation on at most 6 x 32 x 32 texels makes of it.

    Few steps in log radiance are a regulariser of their own: every texel may change by a bounded factor, those that
    the photo insists on go first, and absolute displayed errors keep a wrong spot of the asset from being explained by
    the light. Details finer than the texels stay those of the prior.
    """
    coarse = resize_light(prior, min(_REFINED_RESOLUTION, prior.shape[1]))
    dark = _DARK * observation.light_level
    factor = (optimize_environment(observation, coarse, config, seed) + dark) / (coarse + dark)
    return prior * magnify_light(factor.log(), prior.shape[1]).exp()

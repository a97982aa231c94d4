"""The closed-form part of a prediction: with asset and camera known, a photo is linear in its light.

    minimise  sum_p m_p |A E - I|_p^2 + lambda |E - E0|^2,   E >= 0

A is the split-sum transport of the trusted pixels, I their colours, E0 the prior, and clipped channels are one-sided.
How far the asset and with it A can be trusted differs from object to object, so lambda is chosen on the photo itself:
the light is solved from a part of the object and scored on parts it has not seen.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.device import generator
from lightprobe.distill.probe_pixels import tone_weight
from lightprobe.light import prefilter as prefilters
from lightprobe.light.resize import magnify_light, resize_light
from lightprobe.predict.observation import Observation
from lightprobe.render.refit import refit_contrast
from lightprobe.render.transport import Transport, solve_light

STRENGTHS = (1.0, 0.3, 0.1, 0.03, 0.01)  # lambda, from trusting the prior to trusting the photo
_HELD_OUT = 0.2
_TILE = 12  # pixels; neighbours look alike, so held-out pixels come in tiles


@dataclass(frozen=True)
class SolveConfig:
    """Cost of a solve."""

    pixels: int = 12_288
    """Pixels the light is solved from."""
    iterations: int = 10
    """Iterations of the final solve."""
    trial_resolution: int = 16
    """Texels along each cubemap edge while the strength is chosen."""
    trial_iterations: int = 6
    """Iterations per strength tried; each starts from the one before."""


@dataclass(frozen=True)
class Evidence:
    """Some pixels of an observation as a linear system."""

    transport: Transport
    observed: Tensor  # (K, 3)
    weight: Tensor  # (K,)
    clipped: Tensor  # (K, 3) bool

    @staticmethod
    def of(observation: Observation, chosen: Tensor, resolution: int) -> "Evidence":
        """Return the system of the trusted pixels `chosen` (K,) int64 for lights of `resolution`."""
        color = observation.pixels.color[chosen]
        operator = prefilters.cached(resolution, color.device)
        transport = Transport(observation.gbuffer, operator, observation.rows[chosen])
        return Evidence(transport, color, tone_weight(color, observation.light_level), observation.clipped[chosen])

    def solve(self, prior: Tensor, strength: float, iterations: int, start: Tensor | None = None) -> Tensor:
        """Return the light (6, R, R, 3) >= 0."""
        return solve_light(
            self.transport, self.observed, self.weight, self.clipped, prior,
            regularisation=strength, iterations=iterations, start=start,
        )  # fmt: skip

    def error(self, light: Tensor) -> float:
        """Return the weighted mean squared error of the re-rendered pixels; clipped ones may be brighter for free."""
        difference = self.transport.apply(light) - self.observed
        difference = torch.where(self.clipped, difference.clamp(max=0), difference)
        return float((self.weight[:, None] * difference.square()).sum() / self.weight.sum())


def solve_environment(observation: Observation, prior: Tensor, config: SolveConfig, seed: int) -> Tensor:
    """Return the light (6, R, R, 3) that explains the photo best while staying near `prior` where it says little.

    The strength is chosen and most of the way is gone on a coarser light, whose steps cost a fraction.
    """
    resolution = prior.shape[1]
    coarse_prior = resize_light(prior, min(config.trial_resolution, resolution))
    strength, coarse = choose_strength(observation, coarse_prior, config, seed)
    start = (prior + magnify_light(coarse - coarse_prior, resolution)).clamp(min=0)
    chosen = _subset(torch.arange(len(observation.rows)), config.pixels, seed, "all")
    evidence = Evidence.of(observation, chosen.to(prior.device), resolution)
    light = evidence.solve(prior, strength, config.iterations, start)
    return refit_contrast(evidence.transport, light, evidence.observed, evidence.clipped)


def choose_strength(observation: Observation, prior: Tensor, config: SolveConfig, seed: int) -> tuple[float, Tensor]:
    """Return the strength whose light, solved from four fifths of the photo's tiles, predicts the last fifth best.

    Comes with that light (6, R, R, 3) at the resolution of `prior`.
    """
    fitted, held_out = _tile_split(observation, seed)
    if len(fitted) == 0 or len(held_out) == 0:
        return STRENGTHS[len(STRENGTHS) // 2], prior
    given = Evidence.of(observation, _subset(fitted, config.pixels, seed, "fitted"), prior.shape[1])
    judge = Evidence.of(observation, _subset(held_out, config.pixels, seed, "held-out"), prior.shape[1])
    best = (math.inf, STRENGTHS[0], prior)
    light = prior
    for strength in STRENGTHS:
        light = given.solve(prior, strength, config.trial_iterations, light)
        best = min(best, (judge.error(light), strength, light), key=lambda trial: trial[0])
    return best[1], best[2]


def _tile_split(observation: Observation, seed: int) -> tuple[Tensor, Tensor]:
    """Return (fitted, held out) indices into the trusted pixels, split by square tiles of the photo."""
    pixel = observation.gbuffer.pixel[observation.rows]
    width = observation.gbuffer.width
    across = width // _TILE + 1
    tile = torch.div(torch.div(pixel, width, rounding_mode="floor"), _TILE, rounding_mode="floor") * across
    tile = tile + torch.div(pixel % width, _TILE, rounding_mode="floor")
    count = int(tile.max()) + 1
    held = torch.rand(count, generator=generator(seed, "solve-tiles")) < _HELD_OUT
    held = held.to(pixel.device)[tile]
    return (~held).nonzero()[:, 0], held.nonzero()[:, 0]


def _subset(indices: Tensor, count: int, seed: int, name: str) -> Tensor:
    """Return at most `count` of the indices (N,), chosen at random, in their order."""
    if len(indices) <= count:
        return indices
    order = torch.randperm(len(indices), generator=generator(seed, f"solve-{name}"))
    return indices[order[:count].sort().values.to(indices.device)]

"""The closed-form part of a prediction: with asset and camera known, a photo is linear in its light.

    E = E0 (1 + g + e),     minimise  sum_p m_p |A E - I|_p^2 + lambda |g|^2 + 10 lambda |e|^2

A is the split-sum transport of the trusted pixels, I their colours, E0 the prior; clipped channels are
one-sided. What is sought is a factor on the prior, so that a sun and a shadow count by how much they change
relative to themselves: g (per direction) is common to the channels, e (per direction and channel) is what
colour needs beyond it. Both live on 6 x 8 x 8 texels and are solved for exactly, g first: so smooth a factor
cannot tear the map apart where the asset is wrong, and colours, which a wrong material imitates first, have
to be well supported.

How far the asset can be trusted differs from object to object, so lambda is chosen on the photo itself: the
factor is solved from a part of the object and scored on parts it has not seen. Errors of the asset are alike
all over it, and make following the photo look better than it is; so the strongest pull within a tenth of the
best score is taken. At last the brightness of each channel is fitted once more.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.config.prediction import SolveConfig
from lightprobe.core.device import draw_rows, generator
from lightprobe.light import cubemap
from lightprobe.light import prefilter as prefilters
from lightprobe.light.photometry import beyond_clipping, one_sided_residual, relative_tone_weight
from lightprobe.light.prefilter import BLOCKS
from lightprobe.light.resize import magnify_light, resize_light
from lightprobe.prediction.observation import Observation
from lightprobe.render.coarse_transport import TEXELS, CoarseTransport
from lightprobe.render.transport import Transport

STRENGTHS = (10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01)  # lambda, from trusting the prior to trusting the photo
_HELD_OUT = 0.2  # share of the tiles that choose the strength
_TILE = 12  # pixels; neighbours look alike, so held-out pixels come in tiles
_COLOR = 10.0  # how much more a change of colour costs than one of brightness
_AS_GOOD = 1.1  # a held-out error within this factor of the best is no reason to leave the prior
_DARK = 1e-3  # relative to the light level: a black prior can be raised, too
_NOTHING = 1e-30  # below any gain of a photo: a channel that no pixel tells of has a solution, too
_LARGEST_FACTOR = 10.0  # on the prior's radiance, up or down


@dataclass(frozen=True)
class FitPixels:
    """K pixels of an observation."""

    rows: Tensor  # (K,) rows of the observation's G-buffer
    observed: Tensor  # (K, 3)
    weight: Tensor  # (K,)
    clipped: Tensor  # (K, 3) bool

    @staticmethod
    def of(observation: Observation, candidates: Tensor, count: int, seed: int, name: str) -> "FitPixels":
        """Return at most `count` of the trusted pixels `candidates` (N,) int64, chosen at random."""
        chosen = draw_rows(candidates, count, generator(seed, f"solve-{name}")).to(observation.rows.device)
        color = observation.pixels.color[chosen]
        weight = relative_tone_weight(color, observation.light_level)
        return FitPixels(observation.rows[chosen], color, weight, observation.clipped[chosen])

    def residual(self, render: Tensor) -> Tensor:
        """Return render - observed (K, 3), zero where a clipped pixel is rendered brighter."""
        return one_sided_residual(render, self.observed, self.clipped)


@dataclass(frozen=True)
class Correction:
    """`FitPixels` as a linear system for the factor on a coarse prior, (384, 3)."""

    pixels: FitPixels
    transport: Transport  # of the full light
    matrix: Tensor  # (3, K, 384): change of the pixels per change of the factor
    render: Tensor  # (K, 3) the pixels under the prior

    @staticmethod
    def of(observation: Observation, pixels: FitPixels, prior: Tensor) -> "Correction":
        """Return the system around `prior` (6, R, R, 3)."""
        operator = prefilters.cached(prior.shape[1], prior.device)
        transport = Transport(observation.gbuffer, operator, pixels.rows)
        coarse = resize_light(prior, BLOCKS).reshape(TEXELS, 3) + _DARK * observation.light_level
        matrix = CoarseTransport.of(observation.gbuffer.select(pixels.rows)).matrix * coarse.T[:, None, :]
        return Correction(pixels, transport, matrix, transport.apply(prior))

    def solve(self, strengths: tuple[float, ...]) -> list[Tensor]:
        """Return g + e (384, 3) for every strength."""
        missing = -self.pixels.residual(self.render)
        hidden = self.pixels.clipped & (missing == 0)
        weight = torch.where(hidden, 0.0, self.pixels.weight[:, None])
        weight = (weight / weight.sum().clamp(min=1e-12)).T[..., None]  # (3, K, 1)
        angle = cubemap.solid_angles(BLOCKS, weight.device).reshape(-1) / (4 * math.pi)
        normal = (weight * self.matrix).transpose(1, 2) @ self.matrix  # (3, 384, 384)
        right = self.matrix.transpose(1, 2) @ (weight * missing.T[..., None])  # (3, 384, 1)
        gain = (weight[..., 0] * self.matrix.sum(2).square()).sum(1).clamp(min=_NOTHING)  # (3,)
        found = []
        for strength in strengths:
            ridge = torch.diag_embed(strength * gain[:, None] * angle)
            common = _solve_positive(normal.sum(0) + ridge.sum(0), right.sum(0))
            colored = _solve_positive(normal + _COLOR * ridge, right - normal @ common)
            found.append((common + colored)[..., 0].T)
        return found

    def brightness(self, light: Tensor) -> Tensor:
        """Return the factors (3,) that bring `light` (6, R, R, 3) closest to the photo."""
        render = self.transport.apply(light)
        hidden = beyond_clipping(render, self.pixels.observed, self.pixels.clipped)
        weight = self.pixels.weight[:, None] * ~hidden
        explained = (weight * render.square()).sum(0)
        return torch.where(explained > 0, (weight * render * self.pixels.observed).sum(0) / explained, 1.0)

    def error(self, change: Tensor) -> float:
        """Return the weighted mean squared error of the pixels with the factor 1 + `change` (384, 3)."""
        render = self.render + torch.einsum("cpk,kc->pc", self.matrix, change)
        squared = self.pixels.residual(render).square()
        return float((self.pixels.weight[:, None] * squared).sum() / self.pixels.weight.sum())


def solve_environment(observation: Observation, prior: Tensor, config: SolveConfig, seed: int) -> Tensor:
    """Return the light (6, R, R, 3) >= 0 that explains the photo, near `prior` where that says little."""

    def system(candidates: Tensor, count: int, name: str) -> Correction:
        return Correction.of(observation, FitPixels.of(observation, candidates, count, seed, name), prior)

    fitted, held_out = _tile_split(observation, seed)
    every = system(torch.arange(len(observation.rows)), config.pixels, "all")
    light = prior
    if len(fitted) > 0 and len(held_out) > 0:
        given = system(fitted, config.fitted_pixels, "fitted")
        strength = choose_strength(given, system(held_out, config.judging_pixels, "held-out"))
        light = prior if math.isinf(strength) else changed(prior, every.solve((strength,))[0])
    return light * every.brightness(light)


def choose_strength(given: Correction, judge: Correction) -> float:
    """Return the strongest pull whose change, solved from `given`, serves `judge` best, or infinity."""
    nothing = torch.zeros(TEXELS, 3, device=given.render.device)
    trials = [(math.inf, nothing), *zip(STRENGTHS, given.solve(STRENGTHS), strict=True)]
    errors = [judge.error(change) for _, change in trials]
    bearable = _AS_GOOD * min(errors)
    return next(strength for (strength, _), error in zip(trials, errors, strict=True) if error <= bearable)


def changed(prior: Tensor, change: Tensor) -> Tensor:
    """Return `prior` (6, R, R, 3) times the smooth factor 1 + `change` (384, 3), within bounds."""
    factor = (1 + change).clamp(1 / _LARGEST_FACTOR, _LARGEST_FACTOR).log()
    return prior * magnify_light(factor.reshape(6, BLOCKS, BLOCKS, 3), prior.shape[1]).exp()


def _solve_positive(matrix: Tensor, right: Tensor) -> Tensor:
    return torch.cholesky_solve(right, torch.linalg.cholesky(matrix))


def _tile_split(observation: Observation, seed: int) -> tuple[Tensor, Tensor]:
    """Return (fitted, held out) indices into the trusted pixels, split by square tiles of the photo."""
    pixel = observation.gbuffer.pixel[observation.rows]
    width = observation.gbuffer.width
    across = width // _TILE + 1
    tile = pixel // width // _TILE * across + pixel % width // _TILE
    count = int(tile.max()) + 1
    held = torch.rand(count, generator=generator(seed, "solve-tiles")) < _HELD_OUT
    held = held.to(pixel.device)[tile]
    return (~held).nonzero()[:, 0], held.nonzero()[:, 0]

"""Suns and lamps: what is small and bright in a light, told apart from the rest.

A source is a spherical Gaussian, the usual lobe of such lights:

    L(d) = a exp(kappa (d . s - 1)),   irradiance of a surface that faces it  E = 2 pi a (1/kappa - 1/kappa^2 + ...)

s is its direction, kappa its sharpness. As users think of discs, its size is given as the radius of the disc with the
same mean square angle from s: radius^2 / 2 for a disc, 2 / kappa for the Gaussian, so radius = 2 / sqrt(kappa).

Sources are found where radiance stands out of a ring of some 15 to 30 degrees around it, the strongest first, and each
is taken out, down to the ring's median, before the next is looked for. All of it is deterministic. Directions are
in the light's own axes, z up. An `uncertainty` is only known where a photo tells it (`prediction.source_fit`).
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.photometry import luma
from lightprobe.light.resize import resize_light

MOST = 8  # sources of a light
SMALLEST = math.radians(0.265)  # the sun's radius, below which no source is taken to be
_FINEST = 64  # resolution from which sources are looked for in area averages
_RING = math.radians(15), math.radians(30)  # around a source, where the level of the light beside it is seen
_REACH = math.radians(25)  # of a source from its brightest texel
_STANDS_OUT = 3.0  # times the median of the ring and the mean of the sphere
_FOOT = 0.1  # of the height above the ring at which a source's radius is measured
_TAIL, _GROUND = 1.6, 1.5  # its radii that its tail may reach to, and times the ring's median that it ends at
_LEAST = 0.02  # of the whole light's flux
_NEIGHBOUR = 1.8  # texels' widths within which two texels touch


@dataclass(frozen=True)
class LightSource:
    """A sun or a lamp, infinitely far away."""

    direction: tuple[float, float, float]  # unit, towards the source
    angular_radius: float  # radians, of the disc of its size
    irradiance: tuple[float, float, float]  # linear RGB, of a surface that faces it, in the light's units
    uncertainty: float | None = None  # standard deviation of the irradiance relative to it
    direction_uncertainty: float | None = None  # radians, standard deviation of the direction

    def texels(self, resolution: int, device: torch.device | str = "cpu") -> Tensor:
        """Return its radiance (6, R, R, 3), of exactly its irradiance whatever the resolution."""
        towards = torch.tensor(self.direction, device=device)
        width = math.sqrt(4 * math.pi / (6 * resolution**2))
        sharpness = 4 / max(self.angular_radius, width) ** 2
        cosine = cubemap.directions(resolution, device) @ towards
        shape = torch.exp(sharpness * (cosine - 1))
        received = (shape * cosine.clamp(min=0) * cubemap.solid_angles(resolution, device)).sum()
        return shape[..., None] * (torch.tensor(self.irradiance, device=device) / received)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON value; `from_json` is its inverse."""
        spread = self.direction_uncertainty
        return {
            "direction": list(self.direction),
            "angular_radius_deg": math.degrees(self.angular_radius),
            "irradiance_rgb": list(self.irradiance),
            "uncertainty": self.uncertainty,
            "direction_uncertainty_deg": None if spread is None else math.degrees(spread),
        }

    @staticmethod
    def from_json(value: dict[str, Any]) -> "LightSource":
        """Return the source of `to_json`'s form; raises `KeyError`, `TypeError` or `ValueError` else."""
        x, y, z = (float(number) for number in value["direction"])
        length = math.sqrt(x * x + y * y + z * z)
        r, g, b = (float(number) for number in value["irradiance_rgb"])
        radius = math.radians(float(value["angular_radius_deg"]))
        known = (value.get("uncertainty"), value.get("direction_uncertainty_deg"))
        spread, turn = (None if number is None else float(number) for number in known)
        numbers = [x, y, z, r, g, b, radius, *(n for n in (spread, turn) if n is not None)]
        if not all(math.isfinite(n) for n in numbers) or not 1e-6 < length < 1e6 or min(r, g, b) < 0:
            raise ValueError("no light source has such numbers")
        towards = x / length, y / length, z / length
        radius, turn = min(max(radius, SMALLEST), math.pi), None if turn is None else math.radians(turn)
        return LightSource(towards, radius, (r, g, b), spread, turn)

    def scaled(self, factor: Tensor) -> "LightSource":
        """Return it with its irradiance times `factor` (3,)."""
        r, g, b = (float(e * f) for e, f in zip(self.irradiance, factor.tolist(), strict=True))
        return replace(self, irradiance=(r, g, b))


@dataclass(frozen=True)
class SplitLight:
    """A light as its sources and all the rest."""

    rest: Environment
    sources: tuple[LightSource, ...]  # the one with the greatest irradiance first

    def scaled(self, factor: Tensor) -> "SplitLight":
        """Return it with all radiance times `factor` (3,)."""
        rest = self.rest.scaled(factor.to(self.rest.device))
        return SplitLight(rest, tuple(source.scaled(factor) for source in self.sources))


def find_sources(environment: Environment, most: int = MOST) -> tuple[LightSource, ...]:
    """Return up to `most` suns and lamps of a light, the strongest first; none where nothing stands out."""
    return split_light(environment, most).sources


@torch.no_grad()
def split_light(environment: Environment, most: int = MOST) -> SplitLight:
    """Return up to `most` sources of a light and the rest, which keeps the level around each source."""
    search = _Search(environment)
    found: list[LightSource] = []
    while len(found) < most and (source := search.next_source()) is not None:
        found.append(source)
    found.sort(key=lambda source: -sum(source.irradiance))
    return SplitLight(Environment(search.rest(environment.texels)), tuple(found))


class _Search:
    """A light from which sources are taken one by one."""

    def __init__(self, environment: Environment):
        resolution = min(environment.resolution, _FINEST)
        device = environment.device
        self._light = resize_light(environment.texels, resolution).reshape(-1, 3).double()
        self._given = self._light.clone()
        self._resolution = resolution
        self._direction = cubemap.exact_directions(resolution, device).reshape(-1, 3)
        self._angle = cubemap.exact_solid_angles(resolution, device).reshape(-1)
        self._flux = float((luma(self._light) * self._angle).sum())
        self._passed = torch.zeros(len(self._light), dtype=torch.bool, device=device)

    def next_source(self) -> LightSource | None:
        """Take the brightest source that is left out of the light and return it, or None."""
        while True:
            brightness = torch.where(self._passed, 0.0, luma(self._light))
            peak = int(brightness.argmax())
            if float(brightness[peak]) <= _STANDS_OUT * self._flux / (4 * math.pi):
                return None
            taken, level = self._region(peak)
            excess = (self._light[taken] - level).clamp(min=0) * self._angle[taken, None]
            stands_out = float(luma(self._light[peak])) > _STANDS_OUT * float(luma(level))
            if stands_out and float(luma(excess.sum(0))) >= _LEAST * self._flux:
                self._light[taken] = torch.minimum(self._light[taken], level)
                self._passed |= self._beside(taken, peak)
                return self._source(taken, excess)
            self._passed[taken] = True

    def rest(self, texels: Tensor) -> Tensor:
        """Return `texels` (6, R, R, 3) without the sources; finer texels lose the share of their block."""
        kept = (self._light / self._given.clamp(min=1e-30)).clamp(max=1).float()
        return texels * resize_light(kept.reshape(6, self._resolution, self._resolution, 3), texels.shape[1])

    def _beside(self, taken: Tensor, peak: int) -> Tensor:
        """Return the texels (6 R^2,) bool within reach of a source, whose tails are no sources themselves."""
        cosine = self._direction @ self._direction[peak]
        reach = torch.acos(cosine[taken].clamp(-1, 1)).max() + 2 * self._angle[peak].sqrt()
        return cosine > torch.cos(reach)

    def _region(self, peak: int) -> tuple[Tensor, Tensor]:
        """Return the texels (K,) of the source around `peak`, and the radiance (3,) beside it."""
        apart = torch.acos((self._direction @ self._direction[peak]).clamp(-1, 1))
        ring = (apart > _RING[0]) & (apart < _RING[1])
        level = self._light[ring].median(0).values
        brightness, ground = luma(self._light), luma(level)
        foot = ground + _FOOT * (brightness[peak] - ground)
        core = self._connected(((apart < _REACH) & (brightness >= foot)).nonzero()[:, 0], peak)
        end = _TAIL * apart[core].max() + self._angle[peak].sqrt()
        return self._connected(((apart < end) & (brightness > _GROUND * ground)).nonzero()[:, 0], peak), level

    def _connected(self, near: Tensor, peak: int) -> Tensor:
        """Return the texels of `near` (K,) connected with `peak`; `peak` alone if it is not among them."""
        width = self._angle[near].sqrt()
        step = torch.cdist(self._direction[near], self._direction[near])
        touching = step < _NEIGHBOUR * torch.minimum(width[:, None], width)
        reached = near == peak
        while True:
            wider = reached | touching[reached].any(0)
            if bool((wider == reached).all()):
                return near[reached] if bool(reached.any()) else torch.tensor([peak], device=near.device)
            reached = wider

    def _source(self, taken: Tensor, excess: Tensor) -> LightSource:
        """Return the source of the texels `taken` (K,) whose flux above the level is `excess` (K, 3)."""
        weight = luma(excess)
        direction = self._direction[taken]
        middle = torch.nn.functional.normalize((weight[:, None] * direction).sum(0), dim=0)
        cosine = (direction @ middle).clamp(-1, 1)
        spread = float((weight * torch.acos(cosine).square()).sum() / weight.sum())
        texel = float(self._angle[taken].mean())  # its own mean square angle is a sixth of its area
        irradiance = (excess * cosine.clamp(min=0)[:, None]).sum(0)
        x, y, z = middle.tolist()
        r, g, b = irradiance.tolist()
        return LightSource((x, y, z), math.sqrt(max(2 * (spread - texel / 6), SMALLEST**2)), (r, g, b))

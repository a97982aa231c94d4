"""How plausible the lights of many photos and the object's metals are, as evidence on the light/albedo scale that no
single photo gives.

**View-light correlation.** The light around an object and the place that it is photographed from have nothing
to do with each other, so that over many photos no more light comes from the camera's side than from behind
the object. Lights that were solved under a wrong brightness differ there. Light from behind is seen at
grazing angles, where every surface reflects about as much and in no colour of its own; light from the
camera's side takes the surface's colour. A surface that is taken for too bright therefore asks for light that
is too dim on the camera's side and right behind, for too dark a surface it is the other way round, and each
photo is explained by such a light. Only the horizontal is looked at: cameras look down more often than up,
and light comes from above. Photographers like to have the sun in their back, so that more light from the
camera's side says less than more light from behind. Photos of an object on a turntable have one light as the
camera sees it: they count as one.

**Background level.** A photo that is not cut out shows some of what lights the object, and near things that
the same light falls on. So on the whole the light that is solved for a photo is about as bright as the
photo's background: an object that is taken for ten times too bright gets lights that are ten times too dim
for that. The level of a light, or of pixels, is the mean logarithm of its luma, with a floor. A mean of the
luma itself would be that of the sun, which is hardly ever in the picture, and whose brightness the photo's
white would hide.

**Reflectance of metals.** A metal's base colour is what it reflects, and clean metals reflect half of the light or more:
tungsten and titanium .5, iron .56, copper .7, aluminium .9. Where all reflections take the surface's colour, as on a
polished pot, nothing else tells the scale. Tarnish and a second metal are darker, so that the brighter of an object's metals
count; lacquered metal can have any colour. What is taken for a metal much darker than the rest reflects less than any
dielectric, as soot and leather do (`losses.material_prior`), and tells nothing.

Notation: N photos, R of a light's edge, T texels; nll: negative logarithm of a probability, 0 is the most
probable.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.light import cubemap
from lightprobe.light.photometry import luma
from lightprobe.light.resize import rotate_light
from lightprobe.reconstruction.losses import DARK_METAL
from lightprobe.scene.background import Background

_FEWEST = 8  # photos that say anything
_PHOTOGRAPHERS = 0.1  # of the correlation that their habits may make, light from the camera's side only
_LEAST_SPREAD = 0.3  # of the correlation between photos; that of solved lights is .5 to .6
_SIDE = 8  # texels along the edges of lights that are compared with each other
_FLOOR = 0.05  # of a mean radiance or luma, below which differences hardly count
_RINGS = 16  # of elevation, whose means are taken out
_LEAST_SHOWN = 0.05  # of a photo, that must lie around the object
_USUAL = 0.5  # a light's level over its background's; docs/decisions/surroundings.md
_LEVEL_SPREAD = 0.5  # standard deviation of this between places, which all photos of an object may share
_METAL = 0.65, 0.25  # luma of what clean metals reflect, and the standard deviation of its logarithm
_LACQUERED, _LACQUERED_SHARE = (0.2, 1.0), 0.1  # of coloured or dirty ones; how many of metals they are
_DARKEST = 0.01  # luma, below which all are alike
_BRIGHTER = 0.9  # quantile of an object's metallic points that counts
_FEWEST_METAL = 0.05  # share of points that must be metallic: a few are soon taken for what they are not


@dataclass(frozen=True)
class ViewLightCorrelation:
    """By how much more light comes from the camera's side than from behind the object."""

    mean: float
    """Over photos, of three times the mean of (direction x horizontal direction to the camera) weighted by
    radiance: 0 where both sides are alike, at most 3."""
    error: float
    """Its standard error, photos of one light counted as one."""

    @property
    def nll(self) -> float:
        """How improbable the correlation is, in -ln probability."""
        spread = self.error if self.mean < 0 else (self.error**2 + _PHOTOGRAPHERS**2) ** 0.5
        return 0.5 * (self.mean / spread) ** 2

    @staticmethod
    @torch.no_grad()
    def of(lights: Sequence[Tensor], towards: Sequence[Tensor], up: Tensor) -> "ViewLightCorrelation | None":
        """Return the correlation of N lights (6, R, R, 3) with the directions (3,) towards their cameras.

        up (3,): unit. None for fewer than eight photos whose camera is not right above or below.
        """
        frames = [_frame(at, up) for at in towards]
        seen = [(light, frame) for light, frame in zip(lights, frames, strict=True) if frame is not None]
        if len(seen) < _FEWEST:
            return None
        values = torch.tensor([_one_photo(light, frame[:, 0]) for light, frame in seen], dtype=torch.float64)
        count = len(seen)
        alike = _likeness(torch.stack([rotate_light(light, frame, _SIDE) for light, frame in seen]))
        spread = max(float(values.std()), _LEAST_SPREAD)
        return ViewLightCorrelation(float(values.mean()), spread * ((1 + (count - 1) * alike) / count) ** 0.5)


def _frame(towards: Tensor, up: Tensor) -> Tensor | None:
    """Return the rotation (3, 3) of z to `up` (3,) and x to the horizontal part, if any, of `towards` (3,)."""
    towards, up = towards.cpu(), up.cpu()
    across = towards - (towards @ up) * up
    length = across.norm()
    if length < 1e-3 * towards.norm():
        return None
    front = across / length
    return torch.stack([front, torch.linalg.cross(up, front), up], 1)


def _one_photo(light: Tensor, front: Tensor) -> float:
    """Return what `ViewLightCorrelation.mean` is the mean of: light (6, R, R, 3), horizontal direction (3,)."""
    brightness, cosine = light.mean(-1), cubemap.directions(light.shape[1], light.device) @ front.to(light)
    level = cubemap.sphere_mean(brightness).clamp(min=1e-12)
    return float(3.0 * cubemap.sphere_mean(brightness * cosine) / level)


def _likeness(lights: Tensor) -> float:
    """Return the mean correlation, at least 0, between N lights (N, 6, R, R, 3) as their cameras see them.

    Of log radiance, without what lights have in common: how it falls with elevation, and from front to back.
    """
    luminance = lights.mean(-1).flatten(1)
    level = luminance.mean(1, keepdim=True).clamp(min=1e-12)
    logs = (luminance / level + _FLOOR).log()  # (N, T)
    directions = cubemap.directions(_SIDE, lights.device).reshape(-1, 3)
    weight = cubemap.solid_angles(_SIDE, lights.device).reshape(-1)
    ring = ((directions[:, 2] + 1) * (_RINGS / 2)).long().clamp(max=_RINGS - 1)
    angle = weight.new_zeros(_RINGS).index_add(0, ring, weight).clamp(min=1e-12)
    logs = logs - (logs.new_zeros(len(logs), _RINGS).index_add(1, ring, logs * weight) / angle)[:, ring]
    front = directions[:, 0]
    logs = logs - front * ((logs * front) @ weight / (front.square() @ weight))[:, None]
    logs = logs * weight.sqrt()
    every, own = logs.sum(0).square().sum(), logs.square().sum()
    return max(0.0, float((every - own) / ((len(logs) - 1) * own).clamp(min=1e-12)))


@dataclass(frozen=True)
class BackgroundLevel:
    """How the photos' lights compare with the photos' backgrounds."""

    excess: float  # mean over photos of the light's level over the background's, less what is usual; in ln radiance

    @property
    def nll(self) -> float:
        """How improbable the excess is, in -ln probability."""
        return 0.5 * (self.excess / _LEVEL_SPREAD) ** 2

    @staticmethod
    @torch.no_grad()
    def of(lights: Sequence[Tensor], backgrounds: Sequence[float | None]) -> "BackgroundLevel | None":
        """Return the excess of N lights (6, R, R, 3) over the `background_level` of their photos.

        None for fewer than eight photos that have one.
        """
        pairs = zip(lights, backgrounds, strict=True)
        found = [light_level(light) - level for light, level in pairs if level is not None]
        return BackgroundLevel(sum(found) / len(found) - _USUAL) if len(found) >= _FEWEST else None


@dataclass(frozen=True)
class MetalReflectance:
    """How much of an object is metal, and how bright its metals are."""

    share: float  # of points of the surface
    nll: float  # how improbable what they reflect is, in -ln probability; 0 for an object with hardly any metal

    @staticmethod
    @torch.no_grad()
    def of(base_color: Tensor, metallic: Tensor) -> "MetalReflectance":
        """Return that of points of a surface: base_color (N, 3) linear, metallic (N,)."""
        level = luma(base_color)
        metal = level[(metallic > 0.5) & (level > DARK_METAL * level.mean())]
        share = len(metal) / max(len(level), 1)
        if share < _FEWEST_METAL:
            return MetalReflectance(share, 0.0)
        found = math.log(float(metal.quantile(_BRIGHTER).clamp(min=_DARKEST)))
        return MetalReflectance(share, math.log(_of_metals(math.log(_METAL[0])) / _of_metals(found)))


NO_METAL = MetalReflectance(0.0, 0.0)


def _of_metals(value: float) -> float:
    """Return the density of the logarithm of a metal's luma at `value`: of clean ones and of lacquered ones."""
    clean, lacquered = (
        math.exp(-0.5 * ((value - math.log(median)) / spread) ** 2) / spread
        for median, spread in (_METAL, _LACQUERED)
    )
    return (1 - _LACQUERED_SHARE) * clean + _LACQUERED_SHARE * lacquered


def light_level(light: Tensor) -> float:
    """Return the level of a light (6, R, R, 3) over the whole sphere."""
    return _level(luma(light).reshape(-1), cubemap.solid_angles(light.shape[1], light.device).reshape(-1))


def background_level(background: Background | None) -> float | None:
    """Return the level of a photo's background; None where it is cut out or the object fills the photo."""
    if background is None or background.seen.mean() < _LEAST_SHOWN:
        return None
    return pixels_level(torch.from_numpy(background.color[background.seen]))


def pixels_level(color: Tensor) -> float:
    """Return the level of pixels (K, 3), linear; above 1 they count as 1, as in photos that have a white."""
    return _level(luma(color.clamp(max=1)), torch.ones(len(color)))


def _level(luminance: Tensor, weight: Tensor) -> float:
    """Return the weighted mean logarithm of luma (T,), with a floor."""
    weight = weight / weight.sum()
    floor = _FLOOR * (luminance * weight).sum().clamp(min=1e-9)
    return float(((luminance + floor).log() * weight).sum())

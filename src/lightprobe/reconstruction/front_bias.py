"""Whether lights know where the camera stands: evidence on brightness that does not come from any one photo.

The light around an object and the place that it is photographed from have nothing to do with each other, so
that over many photos no more light comes from the camera's side than from behind the object. Lights that were
solved under a wrong brightness differ there. Light from behind is seen at grazing angles, where every surface
reflects about as much and in no colour of its own; light from the camera's side takes the surface's colour. A
surface that is taken for too bright therefore asks for light that is too dim on the camera's side and right
behind, for too dark a surface it is the other way round, and each photo is explained by such a light.

Only the horizontal is looked at: cameras look down more often than up, and light comes from above.
Photographers like to have the sun in their back, so that more light from the camera's side says less than
more light from behind. Photos of an object on a turntable have one light as the camera sees it: they count as
one.

Notation: N photos, R of a light's edge, T texels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.light import cubemap
from lightprobe.light.resize import rotate_light

_FEWEST = 8  # photos that say anything
_PHOTOGRAPHERS = 0.1  # of the bias that their habits may make, light from the camera's side only
_LEAST_SPREAD = 0.3  # of lights' biases over photos, that of solved lights being .5 to .6
_SIDE = 8  # texels along the edges of lights that are compared with each other
_FLOOR = 0.05  # of a light's mean radiance, below which its texels count as equal
_RINGS = 16  # of elevation, whose means are taken out


@dataclass(frozen=True)
class FrontBias:
    """By how much more light comes from the camera's side than from behind the object."""

    mean: float
    """Over photos, of three times the mean of (direction x horizontal direction to the camera) weighted by
    radiance: 0 where both sides are alike, at most 3."""
    error: float
    """Its standard error, photos of one light counted as one."""

    @property
    def surprise(self) -> float:
        """How unlikely the bias is, in units of ln probability (0 is likely)."""
        spread = self.error if self.mean < 0 else (self.error**2 + _PHOTOGRAPHERS**2) ** 0.5
        return 0.5 * (self.mean / spread) ** 2

    @staticmethod
    @torch.no_grad()
    def of(lights: Sequence[Tensor], towards: Sequence[Tensor], up: Tensor) -> "FrontBias | None":
        """Return the bias of N lights (6, R, R, 3), each with a direction (3,) towards its camera; `up` (3,)
        is a unit.

        None for fewer than eight photos whose camera is not right above or below.
        """
        frames = [_frame(at, up) for at in towards]
        seen = [(light, frame) for light, frame in zip(lights, frames, strict=True) if frame is not None]
        if len(seen) < _FEWEST:
            return None
        values = torch.tensor([_bias(light, frame[:, 0]) for light, frame in seen], dtype=torch.float64)
        count = len(seen)
        alike = _likeness(torch.stack([rotate_light(light, frame, _SIDE) for light, frame in seen]))
        spread = max(float(values.std()), _LEAST_SPREAD)
        return FrontBias(float(values.mean()), spread * ((1 + (count - 1) * alike) / count) ** 0.5)


def _frame(towards: Tensor, up: Tensor) -> Tensor | None:
    """Return the rotation (3, 3) of z to `up` (3,) and x to the horizontal part of `towards` (3,), None
    without one.
    """
    towards, up = towards.cpu(), up.cpu()
    across = towards - (towards @ up) * up
    length = across.norm()
    if length < 1e-3 * towards.norm():
        return None
    front = across / length
    return torch.stack([front, torch.linalg.cross(up, front), up], 1)


def _bias(light: Tensor, front: Tensor) -> float:
    """Return the bias of a light (6, R, R, 3) towards a horizontal direction (3,); see `FrontBias.mean`."""
    brightness, cosine = light.mean(-1), cubemap.directions(light.shape[1], light.device) @ front.to(light)
    level = cubemap.sphere_mean(brightness).clamp(min=1e-12)
    return float(3.0 * cubemap.sphere_mean(brightness * cosine) / level)


def _likeness(lights: Tensor) -> float:
    """Return the mean correlation, at least 0, between N lights (N, 6, R, R, 3) as their cameras see them.

    Of log radiance, without what lights have in common: how it falls with elevation, and the bias itself.
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

"""What photos show around the object, as evidence on how bright it is.

Light and base colour share a factor that the object alone hardly tells (`reconstruction.gauge`). A photo that
is not cut out shows some of what lights the object, and near things that the same light falls on. So on the
whole the light that is solved for a photo is about as bright as what the photo shows around the object: an
object that is taken for ten times too bright gets lights that are ten times too dim for that.

The level of a light, or of pixels, is the mean logarithm of their luma, with a floor. A mean of the luma
itself would be that of the sun, which is hardly ever in the picture, and whose brightness the photo's white
would hide.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.light import cubemap
from lightprobe.light.photometry import luma
from lightprobe.scene.background import load_background
from lightprobe.scene.photo import Photo

_FEWEST = 8  # photos that say anything
_LEAST_SHOWN = 0.05  # of a photo, that must lie around the object
_FLOOR = 0.05  # of the mean luma, which is added to all of it
_USUAL = 0.5  # a light's level over that of what is seen of it; docs/decisions/surroundings.md
_SPREAD = 0.5  # standard deviation of this between places, which all photos of an object may share


@dataclass(frozen=True)
class Surroundings:
    """How the photos' lights compare with what is seen around the object."""

    excess: float  # mean over photos of the light's level over the surroundings', less what is usual; in ln radiance

    @property
    def surprise(self) -> float:
        """How unlikely this is, in units of ln probability (0 is likely)."""
        return 0.5 * (self.excess / _SPREAD) ** 2

    @staticmethod
    @torch.no_grad()
    def of(lights: Sequence[Tensor], shown: Sequence[float | None]) -> "Surroundings | None":
        """Return it for N lights (6, R, R, 3) and the levels of what their photos show; None for fewer than
        eight.
        """
        found = [
            light_level(light) - level
            for light, level in zip(lights, shown, strict=True)
            if level is not None
        ]
        return Surroundings(sum(found) / len(found) - _USUAL) if len(found) >= _FEWEST else None


def light_level(light: Tensor) -> float:
    """Return the level of a light (6, R, R, 3) over the whole sphere."""
    return _level(luma(light).reshape(-1), cubemap.solid_angles(light.shape[1], light.device).reshape(-1))


def shown_level(photo: Photo) -> float | None:
    """Return the level of what a photo shows around the object; None where it is cut out or the object fills
    it.
    """
    background = load_background(photo)
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

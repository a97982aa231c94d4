"""Whether a photo can be what it is taken for: this object, seen by this camera, under one light.

A map can be fitted to any photo, and one fitted to nonsense looks as sure as another. But with object and
camera known the photo is linear in its light, and no light explains nonsense. A light E >= 0 of 6 x 4 x 4
texels is fitted to the photo's pixels in the white squares of a chess board laid over it and judged on those
in the black ones, and the other way round:

    residual    root mean square of t(A E) - t(I) on the pixels that E was not fitted to
    explained   1 - residual^2 / (contrast^2 + noise^2),  contrast^2 = variance of t(I), per channel

A is the photo's coarse transport (`render.coarse_transport`), I its colours at a usual exposure, t(x) =
sRGB(log(1 + x)) as in Phase I, so that differences are displayed ones. 1 says that all the photo shows is
this object under some light, 0 that one colour all over would have done as well. Clipped pixels are
one-sided. The same of t(I) less its grey tells colours in a wrong order, which tinted light explains in part.
Mask and rasterised object tell a wrong pose even of an object that looks alike from everywhere: `overlap` and
`offset` (`Observation`).

Photos that are said to show one light are judged together, and one E for all of them must explain them about
as well as an E for each: `apart`, the mean over photos of the logarithm of the ratio of the two residuals.

The verdict is about the photo, not about the method that predicts its light: every method gets the same.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import torch
from torch import Tensor

from lightprobe.light.photometry import exposure_unit, one_sided_residual, relative_tone_weight, tone_map
from lightprobe.prediction.observation import SAME_PLACE, Observation
from lightprobe.render.coarse_transport import CoarseTransport

_PIXELS = 1024  # that the verdict's light is solved from
_SIDE = 4  # texels along a cubemap edge of the light that is fitted
_STRENGTH = 0.03  # of the pull to a grey light, relative to what the pixels weigh
_STEPS = 50  # of its accelerated descent
_SQUARES = 6  # of the chess board, along the side of a square with the object's area
_NOISE = 0.02  # displayed; contrast below it is as good as none
_LEAST = 1e-6  # displayed residual whose logarithm is taken

# The limits lie between 36 good test photos of three objects, two of them trained briefly, and the same
# photos spoilt (docs/decisions/photo-verdict.md).
_BLACK = 1e-5  # a photo without light; what is nearly black and cannot be read is found unexplained
_ALL_WHITE = 0.9  # white: 1; eight times too bright: at most .83
_NOTHING_EXPLAINED = 0.0  # negatives, grey, noise: below, the last just below on a smooth object
_WELL_EXPLAINED = 0.6  # good: .63 and more; turned by .2: at most .60; moved by .05 across the view: .56
_CHROMA_EXPLAINED = 0.55  # good: .71 and more; red, green and blue exchanged: at most .47
_MUCH_CLIPPED = 0.4  # good: at most .11; three times too bright: .48, eight times: .25 to .83
_BESIDE = 0.025  # good: .001, the cape's own masks and hull .024; moved by .05 across the view: .049 and more
_APART = 0.25  # two to four photos of one light: at most .24; of different lights mostly above .3
_DOUBT = 0.3  # doubtful photos of the demo: their maps err by .16 to .38 more in ln radiance
_SUSPECTS = (
    "is the camera this photo's own, the object the one that was trained and trained long enough, and are the colours "
    "neither inverted nor swapped?"
)


class PhotoStatus(StrEnum):
    """What to do with a photo's map."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"


@dataclass(frozen=True)
class PhotoVerdict:
    """What was measured on a photo, and what follows from it."""

    residual: float  # displayed, 0 to 1: root mean square of what no light explains
    explained: float  # at most 1; see the module's head
    explained_chroma: float  # the same of what the colours differ from grey by
    clipped: float  # share of the object's values that are clipped
    level: float  # mean linear value of the object's pixels
    overlap: float  # of mask and rasterised object, intersection over union
    offset: float  # between the centres of both, in object radii
    apart: float | None = None  # of several photos; see the module's head
    mask_mistake: str | None = None  # as `Observation.mask_mistake`

    @property
    def status(self) -> PhotoStatus:
        """The worst finding's status."""
        found = {status for status, _ in self._findings()}
        order = (PhotoStatus.REFUSED, PhotoStatus.DOUBTFUL)
        return next((status for status in order if status in found), PhotoStatus.GOOD)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The findings of that status, and what to do about each; none for a good photo."""
        return tuple(sentence for status, sentence in self._findings() if status is self.status)

    @property
    def doubt(self) -> float:
        """What the photo adds to the error to expect of ln radiance: 0 for a good one."""
        return 0.0 if self.status is PhotoStatus.GOOD else _DOUBT

    def to_json(self) -> dict[str, Any]:
        """Return a JSON value: the measures, the status and the sentences."""
        return {**vars(self), "status": self.status.value, "sentences": list(self.sentences)}

    def _findings(self) -> list[tuple[PhotoStatus, str]]:
        nothing = tells_nothing(self.clipped, self.level)
        if nothing is not None:
            return [(PhotoStatus.REFUSED, nothing)]
        if self.explained <= _NOTHING_EXPLAINED:
            return [(PhotoStatus.REFUSED, f"No light makes this object look like this photo: {_SUSPECTS}")]
        return [(PhotoStatus.DOUBTFUL, sentence) for sentence in self._doubts()]

    def _doubts(self) -> Iterator[str]:
        if self.overlap < SAME_PLACE:
            reason = (
                "unless the mask leaves part of the object out, the camera or the object is another one, and the map is "
                "wrong."
            )
            yield (
                f"The mask and the object as this camera sees it overlap by only {100 * self.overlap:.0f} %: "
                f"{self.mask_mistake or reason}"
            )
        elif self.offset > _BESIDE:
            yield (
                f"The mask lies {self.offset:.2f} object radii beside the object as this camera sees it; estimate the "
                "camera again, or correct the mask."
            )
        if self.explained < _WELL_EXPLAINED:
            yield (
                f"Light explains only {100 * max(self.explained, 0):.0f} % of what this photo shows of the object: "
                f"{_SUSPECTS}"
            )
        elif self.explained_chroma < _CHROMA_EXPLAINED:
            yield (
                f"Light explains only {100 * max(self.explained_chroma, 0):.0f} % of the colours of the object in this "
                "photo; are red, green and blue in their order, and is it the object that was trained?"
            )
        if self.clipped > _MUCH_CLIPPED:
            yield (
                f"{100 * self.clipped:.0f} % of the object's values are clipped to white, which hides how bright its "
                "light is; expose the photo for the object."
            )
        if self.apart is not None and self.apart > _APART:
            yield (
                f"One light for all misses these photos by {100 * math.expm1(self.apart):.0f} % more than a light for "
                "each; were they taken under one light, with one white balance, and are cameras and exposures right?"
            )


def tells_nothing(clipped: float, level: float) -> str | None:
    """Return why a photo whose object is black, or white all over, tells nothing about its light; else None.

    clipped, level: as in `PhotoVerdict`.
    """
    if level <= _BLACK:
        return "The object is black in this photo, which tells nothing about its light."
    if clipped >= _ALL_WHITE:
        told = f"{100 * clipped:.0f} % of the object's values are clipped to white"
        return f"{told}, which tell nothing about the light; expose the photo for the object."
    return None


@torch.no_grad()
def judge(observation: Observation, seed: int) -> PhotoVerdict:
    """Return the verdict on the photo of `observation`; deterministic, whatever its exposure."""
    pixels = _Judged.of(observation, exposure_unit(observation.pixels.color), observation.light_level, seed)
    difference, target = pixels.difference(pixels.lights()), pixels.target
    return PhotoVerdict(
        residual=_root_mean_square(difference),
        explained=_explained(difference, target),
        explained_chroma=_explained(difference - difference.mean(0), target - target.mean(0)),
        clipped=float(observation.clipped.float().mean()),
        level=float(observation.pixels.color.mean()),
        overlap=observation.overlap,
        offset=observation.offset,
        mask_mistake=observation.mask_mistake,
    )


@torch.no_grad()
def judge_together(photos: Sequence[Observation], joint: Observation, seed: int) -> PhotoVerdict:
    """Return the verdict on photos of one light and exposure, `joint` when put one below the other."""
    verdict = judge(joint, seed)
    if len(photos) < 2:
        return verdict
    unit = exposure_unit(joint.pixels.color)
    singly = [_Judged.of(photo, unit, joint.light_level, seed) for photo in photos]
    common = _Judged.joined(singly).lights()

    def log_residual(photo: _Judged, lights: Tensor) -> float:
        return math.log(max(_root_mean_square(photo.difference(lights)), _LEAST))

    apart = [log_residual(photo, common) - log_residual(photo, photo.lights()) for photo in singly]
    return replace(verdict, apart=sum(apart) / len(apart))


@dataclass(frozen=True)
class _Judged:
    """Some trusted pixels of a photo, and what the two lights that explain them are fitted to."""

    matrix: Tensor  # (3, P, T) coarse transport
    color: Tensor  # (3, P) at a usual exposure
    clipped: Tensor  # (3, P) bool
    black: Tensor  # (P,) bool: in black squares of the chess board
    weight: Tensor  # (2, 3, P): in the fit to the white squares, and to the black ones
    level: Tensor  # () of a light of which no pixel tells anything

    @staticmethod
    def of(observation: Observation, unit: Tensor, level: Tensor, seed: int) -> "_Judged":
        """Draw a photo's pixels; unit: what their usual exposure divides colours by, level: of its light."""
        chosen = observation.drawn(_PIXELS, seed, "verdict")
        color, clipped = observation.pixels.color[chosen], observation.clipped[chosen].T
        matrix = CoarseTransport.of(observation.gbuffer.select(observation.rows[chosen])).broader(_SIDE)
        trust = relative_tone_weight(color, level) * ~clipped
        black = _black_squares(observation, chosen)
        weight = torch.stack([trust * ~black, trust * black])
        return _Judged(matrix, color.T / unit, clipped, black, weight, level / unit)

    @staticmethod
    def joined(photos: "Sequence[_Judged]") -> "_Judged":
        """Return the pixels of all photos, of one level."""
        keys = ("color", "clipped", "black", "weight")
        parts = {key: torch.cat([vars(one)[key] for one in photos], -1) for key in keys}
        return _Judged(matrix=torch.cat([one.matrix for one in photos], 1), level=photos[0].level, **parts)

    @property
    def target(self) -> Tensor:
        """The displayed colours (3, P)."""
        return tone_map(self.color)

    def lights(self) -> Tensor:
        """Return the lights (2, 3, T) that explain the white squares best, and the black ones."""
        return _fitted(self.matrix, self.color, self.weight, self.level)

    def difference(self, lights: Tensor) -> Tensor:
        """Return t(A E) - t(I) (3, P), each pixel under the one of `lights` (2, 3, T) it was kept from."""
        renders = (self.matrix @ lights[..., None])[..., 0]  # (2, 3, P)
        displayed = tone_map(torch.where(self.black, renders[0], renders[1]))
        return one_sided_residual(displayed, self.target, self.clipped)


def _root_mean_square(difference: Tensor) -> float:
    return float(difference.square().mean().sqrt())


def _explained(difference: Tensor, target: Tensor) -> float:
    """Return 1 less the share of the variance of `target` (3, P), per channel, that is in `difference`."""
    contrast = (target - target.mean(1, keepdim=True)).square().mean()
    return 1 - float(difference.square().mean() / (contrast + _NOISE**2))


def _fitted(matrix: Tensor, observed: Tensor, weight: Tensor, level: Tensor) -> Tensor:
    """Return lights (2, 3, T) >= 0 that explain the pixels best, one for each of two weights.

    matrix (3, P, T) >= 0, observed (3, P), weight (2, 3, P) >= 0. Where no pixel has weight the light is
    `level` (). Projected gradient steps with Nesterov's momentum, scaled by the row sums of the normal
    matrix, its majorant.
    """
    weight = weight / weight.sum(-1, keepdim=True).clamp(min=1e-12)
    normal = (matrix.mT * weight[..., None, :]) @ matrix
    gain = (weight * matrix.sum(-1).square()).sum(-1, keepdim=True)
    pull = _STRENGTH * gain / matrix.shape[2]
    right = ((weight * observed)[..., None, :] @ matrix)[..., 0, :] + pull * level
    majorant = (normal.sum(-1) + pull).clamp(min=1e-12)
    light = ahead = level.expand_as(right)
    for step in range(_STEPS):
        gradient = (normal @ ahead[..., None])[..., 0] + pull * ahead - right
        before, light = light, (ahead - gradient / majorant).clamp(min=0)
        ahead = light + step / (step + 3) * (light - before)
    return light


def _black_squares(observation: Observation, chosen: Tensor) -> Tensor:
    """Return which of the trusted pixels `chosen` (P,) lie in black squares of the chess board, (P,) bool."""
    side = max(1, round(math.sqrt(len(observation.rows)) / _SQUARES))
    pixel, width = observation.gbuffer.pixel[observation.rows[chosen]], observation.gbuffer.width
    return (pixel % width // side + pixel // width // side) % 2 == 1

"""How far a predicted map can be trusted, direction by direction, and confidence as colour.

    confidence = exp(-e),   e = the error to expect of ln radiance

so that .5 says: probably off by a factor of two. e is a weighted sum of causes, every weight >= 0:

    unseen      1 / (1 + s / mean s),  s = A^T w: how much of the photo's light came from there, shadows included
    unpinned    1 / (1 + d / mean d),  d = diag(A^T W A): how much the photo would change if that direction did.
                Directions that nearly share their pixels, as under a matte surface, have much s and little d
    bright,     how many e-folds the map lies above or below its own mean there: lamps are sharper than any
    dark        prediction, darkness turned out to be about as true as the rest
    rough       e-folds between a direction and its neighbours within some ten degrees: detail is least certain

A is the transport of the photo's pixels (`render.transport`), w the pixels' weights, W = diag(w). d is
estimated with random signs z: E[(A^T sqrt(W) z)^2] = diag(A^T W A). The weights of the sum were fitted to
simulated photos of six objects (`tools/fit_confidence.py`, docs/decisions/confidence-weights.md). How much a
single object tells of its light at all, no cause says: the sum is multiplied by what simulated photos of that
object ask for (`models.light_accuracy`). The evaluation checks all of it on test photos.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.device import generator
from lightprobe.light import cubemap, prefilter
from lightprobe.light.photometry import relative_tone_weight
from lightprobe.light.resize import magnify_light, resize_light
from lightprobe.prediction.observation import Observation
from lightprobe.render.transport import Transport

_RESOLUTION = 16  # texels along a cubemap edge of the transport looked at
_BLURRED = 8  # the same of the blurred map that detail is measured against
_PIXELS = 2048  # that the light's sensitivity is estimated from
_PROBES = 4  # random sign vectors; three channels each
_FLOOR = 0.02  # of the mean radiance: darker is all alike
CAUSES = ("unseen", "unpinned", "bright", "dark", "rough")
RANGE = (0.3, 0.7)  # of colours: off by a factor of 3.3, and of 1.4; nearly all confidences lie between
TICKS = (0.3, 0.4, 0.5, 0.6, 0.7)  # of the legend, confidences
# Dark to bright in even steps (viridis), sRGB: differences still show in grey and to the colour-blind.
_STOPS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")


@dataclass(frozen=True)
class Weights:
    """How much each cause adds to the expected error of ln radiance, and what is left without any."""

    unseen: float
    unpinned: float
    bright: float
    dark: float
    rough: float
    least: float


FITTED = Weights(unseen=0.0, unpinned=0.09, bright=0.18, dark=0.01, rough=0.54, least=0.35)


ESTIMATED = Weights(unseen=0.0, unpinned=0.10, bright=0.15, dark=0.0, rough=0.72, least=0.37)


def confidence(
    observation: Observation,
    environment: Tensor,
    *,
    fitted: bool,
    seed: int,
    scale: float = 1.0,
    doubt: float = 0.0,
) -> Tensor:
    """Return the confidence (6, R, R) in (0, 1) of a map (6, R, R, 3) predicted from `observation`.

    The same arguments give the same bits.

    fitted: whether the map was fitted to the photo's pixels, which leaves errors of another kind.
    scale: how many times as large as a usual object's the errors are with this one (`models.light_accuracy`).
    doubt: what the photo's verdict adds to the error, >= 0 (`prediction.verdict`); 0 for a good photo.
    """
    weights = FITTED if fitted else ESTIMATED
    error = torch.full_like(environment[..., 0], weights.least)
    for name, cause in error_causes(observation, environment, seed).items():
        error += getattr(weights, name) * cause
    return torch.exp(-scale * error - doubt)


@torch.no_grad()
def error_causes(observation: Observation, environment: Tensor, seed: int) -> dict[str, Tensor]:
    """Return what may make the map wrong, each (6, R, R) >= 0, by the names in `CAUSES`."""
    resolution = environment.shape[1]
    evidence = _evidence(observation, min(_RESOLUTION, resolution), seed)
    causes = {
        name: _lack(magnify_light(seen[..., None].expand(-1, -1, -1, 3).contiguous(), resolution)[..., 0])
        for name, seen in zip(CAUSES, evidence, strict=False)
    }
    radiance = environment.mean(-1)
    floor = _FLOOR * _mean(radiance)
    if float(floor) <= 0:  # a black map: nothing stands out
        return causes | {name: torch.zeros_like(radiance) for name in CAUSES[2:]}
    folds = torch.log(radiance + floor)
    smooth = magnify_light(resize_light(environment, min(_BLURRED, resolution)), resolution).mean(-1)
    above = folds - _mean(folds)
    detail = (folds - torch.log(smooth + floor)).abs()
    return causes | {"bright": above.clamp(min=0), "dark": (-above).clamp(min=0), "rough": detail}


def _evidence(observation: Observation, resolution: int, seed: int) -> tuple[Tensor, Tensor]:
    """Return s and d (6, r, r) per steradian and per square steradian, from evenly chosen pixels."""
    count = len(observation.rows)
    device = observation.rows.device
    chosen = torch.linspace(0, count - 1, min(count, _PIXELS), device=device).round().long()
    transport = Transport(observation.gbuffer, prefilter.cached(resolution, device), observation.rows[chosen])
    weight = relative_tone_weight(observation.pixels.color[chosen], observation.light_level)
    weight = weight[:, None].expand(-1, 3)
    weight = weight / weight.sum()
    angle = cubemap.solid_angles(resolution, device)
    seen = transport.adjoint(weight).mean(-1) / angle
    pinned = torch.zeros_like(seen)
    for probe in range(_PROBES):
        bits = torch.randint(0, 2, weight.shape, generator=generator(seed, "confidence", probe)).to(weight)
        pinned += transport.adjoint(weight.sqrt() * (bits * 2 - 1)).square().mean(-1)
    return seen, pinned / (_PROBES * angle.square())


def _lack(measure: Tensor) -> Tensor:
    """Return 1 / (1 + measure / mean measure): 1 where there is none, 1/2 where there is as much as usual."""
    return 1 / (1 + measure / _mean(measure).clamp_min(1e-30))


def _mean(values: Tensor) -> Tensor:
    angle = cubemap.solid_angles(values.shape[1], values.device)
    return (values * angle).sum() / angle.sum()


def confidence_colors(confidence: np.ndarray) -> np.ndarray:
    """Return the sRGB colours (..., 3) float32 in [0, 1] of confidences of any shape."""
    place = (confidence - RANGE[0]) / (RANGE[1] - RANGE[0])
    at = np.linspace(0, 1, len(_STOPS))
    stops = np.array([[int(stop[i : i + 2], 16) / 255 for i in (1, 3, 5)] for stop in _STOPS])
    return np.stack([np.interp(place, at, channel) for channel in stops.T], -1).astype(np.float32)


def css_gradient() -> str:
    """Return the colours from left to right as CSS, which blends them as `confidence_colors` does."""
    return f"linear-gradient(to right, {', '.join(_STOPS)})"


def ticks() -> list[tuple[float, str, str]]:
    """Return (place, confidence, factor of the error to expect) at `TICKS`; places run from 0 to 1.

    The first tick stands for all lower confidences, too.
    """
    span = RANGE[1] - RANGE[0]
    marks = [((tick - RANGE[0]) / span, f"{tick:.1f}", f"×{1 / tick:.2g}") for tick in TICKS]
    place, number, factor = marks[0]
    return [(place, f"≤ {number}", f"≥ {factor}"), *marks[1:]]

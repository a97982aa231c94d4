"""The background of a photo as evidence: the part of the light that the camera saw directly.

Where the far environment is seen, its radiance is known. What this says about other directions follows from
how predicted maps err: over wide angles, and by the more, the lower their confidence. With y = ln(background
/ map), the correction x(d) of ln radiance is a Gaussian process given y (kriging; Rasmussen and Williams,
Gaussian Processes for Machine Learning, 2006, section 2.2):

    x(d) = e(d) u(d),   u ~ N(0, exp(-angle / width))

with e(d) = -ln(confidence) the error to expect. The map has been fitted to the photo, so the correction must
leave the photo as it is: its pixels are observations of A E x = 0, A the transport and E the map. All this is
linear and solved at 6 x 8 x 8 texels. The process's deviation, relative to the deviation without the
background, is what remains of e.

Directions at which the background is clipped are lower bounds. What stands near the object, such as a table
or a hand, is not its far environment: a texel whose background the map contradicts by far more than its
expected error is left out, and so is a background that does so in the mean.
"""

import math
from enum import StrEnum

import torch
from torch import Tensor

from lightprobe.light import cubemap
from lightprobe.light.photometry import luma
from lightprobe.light.prefilter import BLOCKS
from lightprobe.light.resize import magnify_light, resize_light
from lightprobe.prediction.observation import Observation
from lightprobe.prediction.solve import Correction, FitPixels
from lightprobe.render.coarse_transport import TEXELS
from lightprobe.render.seen_light import SeenLight

_FLOOR = 0.02  # of the map's mean radiance: darker is all alike
_WIDTH = math.radians(25)  # over which what errors have in common falls to 1/e
_NOISE = 0.05  # variance of what a seen texel's mean tells of it, relative to e^2
_PHOTO = 100.0  # inverse variance of the photo's relative change, all pixels together
_PIXELS = 1024  # of the photo that stand for all
_COVERED = 0.3  # share of a texel that has to be seen
_OUTLIER = 4.0  # |y| / e from which a texel's background is something else
_CONTRADICTED = 2.5  # root mean square of y / e from which the whole background is
_LEAST_ERROR = 0.1  # of ln radiance where the background is seen: texels are means, photos are 8 bit


class BackgroundUse(StrEnum):
    """What became of a photo's background."""

    ABSENT = "absent"
    """There is none, it was not asked for, or too little of it is seen."""
    USED = "used"
    """The map follows it."""
    CONTRADICTED = "contradicted"
    """The object's reflections contradict it: it is probably near the object, and was left out."""


def with_background(
    observation: Observation, light: Tensor, confidence: Tensor, seen: SeenLight, seed: int
) -> tuple[Tensor, Tensor, BackgroundUse]:
    """Return a fitted map (6, R, R, 3) and its confidence (6, R, R), corrected by what is `seen`.

    Both are returned as they are where there is no use for the background.
    """
    floor = _FLOOR * luma(cubemap.sphere_mean(light))
    missing = (seen.radiance + floor).log() - (light + floor).log()
    missing = torch.where(seen.clipped, missing.clamp(min=0), missing)
    error = -confidence.log()
    share = seen.share * (missing.abs().amax(-1) < _OUTLIER * error)
    known, covered = _averages(missing, share)
    spread = resize_light(error[..., None].expand_as(light), BLOCKS)[..., 0].reshape(-1)
    rows = (covered > _COVERED).nonzero()[:, 0]
    mostly = cubemap.sphere_mean(share) < 0.5 * cubemap.sphere_mean(seen.share)
    if mostly or _root_mean_square(known[rows] / spread[rows, None]) > _CONTRADICTED:
        return light, confidence, BackgroundUse.CONTRADICTED
    if len(rows) == 0:
        return light, confidence, BackgroundUse.ABSENT
    change, left = _conditioned(spread, known[rows], rows, _photo_changes(observation, light, seed))
    change = _magnified(change, light.shape[1])
    left = _magnified(left[:, None].expand(-1, 3), light.shape[1])[..., 0]
    change = torch.lerp(change, missing, share[..., None])
    direct = torch.where(seen.clipped.any(-1), error, error.clamp(max=_LEAST_ERROR))
    error = torch.lerp(error * left, direct, share)
    return ((light + floor) * change.exp() - floor).clamp(min=0), torch.exp(-error), BackgroundUse.USED


def _root_mean_square(values: Tensor) -> float:
    return float(values.square().mean().sqrt()) if values.numel() else 0.0


def _magnified(values: Tensor, resolution: int) -> Tensor:
    """Return the values (384, 3) of blocks of the sphere smoothly at 6 x R x R texels."""
    return magnify_light(values.reshape(6, BLOCKS, BLOCKS, 3).contiguous(), resolution)


def _averages(values: Tensor, share: Tensor) -> tuple[Tensor, Tensor]:
    """Return the means (384, 3) of `values` (6, R, R, 3) over the seen `share`, and its means (384,)."""
    angle = cubemap.solid_angles(values.shape[1], values.device)
    factor = values.shape[1] // BLOCKS
    weighted = torch.cat([values * share[..., None], share[..., None]], -1) * angle[..., None]
    total = weighted.reshape(6, BLOCKS, factor, BLOCKS, factor, 4).sum((2, 4)).reshape(TEXELS, 4)
    whole = cubemap.solid_angles(BLOCKS, values.device).reshape(-1)
    return total[:, :3] / total[:, 3:].clamp_min(1e-12), total[:, 3] / whole


def _photo_changes(observation: Observation, light: Tensor, seed: int) -> Tensor:
    """Return the matrices Q (3, 384, 384) of how changes x (384,) of ln radiance change the photo's channels.

    x Q x is the weighted mean square of the pixels' change over that of the pixels: 1 where every x is 1.
    """
    every = torch.arange(len(observation.rows), device=observation.rows.device)
    system = Correction.of(observation, FitPixels.of(observation, every, _PIXELS, seed, "background"), light)
    weight = torch.where(system.pixels.clipped, 0.0, system.pixels.weight[:, None]).T[..., None]
    changes = (weight * system.matrix).mT @ system.matrix
    whole = (weight[..., 0] * system.matrix.sum(2).square()).sum(1)
    return changes / whole.clamp_min(1e-30)[:, None, None]


def _conditioned(spread: Tensor, known: Tensor, rows: Tensor, photo: Tensor) -> tuple[Tensor, Tensor]:
    """Return the expected x (384, 3) given `known` (K, 3) at `rows` and the photo, and its deviation left.

    spread (384,): e(d). photo (3, 384, 384): from `_photo_changes`. The deviation (384,) is that of the mean
    channel, relative to the deviation without the background.
    """
    directions = cubemap.exact_directions(BLOCKS, spread.device).reshape(-1, 3)
    alike = torch.exp(-torch.acos((directions @ directions.T).clamp(-1, 1)) / _WIDTH)
    spread, known, photo = spread.double(), known.double(), photo.double()
    # (3, 384, 384) precision of u
    before = torch.cholesky_inverse(torch.linalg.cholesky(alike)) + _PHOTO * spread[:, None] * photo * spread
    seen = torch.zeros_like(spread)
    seen[rows] = 1 / _NOISE
    precision = before + torch.diag(seen)
    told = torch.zeros(len(spread), 3).to(spread).index_copy(0, rows, known / spread[rows, None] / _NOISE)
    found = torch.cholesky_solve(told.T[..., None], torch.linalg.cholesky(precision))[..., 0]  # (3, 384)
    after, without = (_variances(one.mean(0)) for one in (precision, before))
    return (spread * found).T.float(), (after / without).sqrt().float()


def _variances(precision: Tensor) -> Tensor:
    """Return the diagonal (N,) of the inverse of a positive definite matrix (N, N)."""
    return torch.cholesky_inverse(torch.linalg.cholesky(precision)).diagonal()

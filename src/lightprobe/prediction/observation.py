"""What one photo, or several photos under one light, tell about the light: trusted pixels on the known
object.

A pixel is trusted when the object covers it in the photo (mask) and in the rasterised asset. Large photos are
reduced by area averaging first, so that the cost of a prediction is bounded; the average of linear light is
what a coarser camera would have seen.

Notation for several photos: I_i the pixels of photo i, A_i their transport, s_i the photo's exposure relative
to the first one's, E the light in the exposure of the first photo: I_i = s_i A_i E. Divided by their
exposures and put one below the other, the photos are one larger photo, and everything that finds light in one
photo finds it in all of them together.

Exposures that are not known are found with the light: for given s the best coarse E is a linear solve, for
given E each s_i is a ratio, and the two are done in turn. Where photos look at different sides of a light,
hardly anything tells their exposures, and errors of the asset would; so a photo's ratio counts the more, the
better the light explains its pixels, against an expectation that the camera's settings were nearly the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.device import draw_rows, generator
from lightprobe.core.errors import InputError
from lightprobe.light.photometry import relative_tone_weight
from lightprobe.models.probe_pixels import ProbePixels, probe_pixels
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.gbuffer import GBuffer
from lightprobe.scene.camera import Camera
from lightprobe.scene.consistency import overlap
from lightprobe.scene.photo import OPAQUE, Pixels

_HALF = 0.5  # coverage from which a pixel counts as the object's
_FEWEST_PIXELS = 16  # that a light can be found from
SAME_PLACE = 0.8  # overlap of mask and object; right cameras have more than .94, photos from the internet too
_PIXELS = 1024  # of each photo that exposures are found from
_STRENGTH = 0.03  # of the coarse light's pull to grey
_TURNS = 20  # of light and exposures; they settle to a thousandth in about ten
_SPREAD = 0.3  # expected of ln s where nothing is known


@dataclass(frozen=True)
class Observation:
    """One photo on the asset; K trusted pixels, on one device."""

    gbuffer: GBuffer
    rows: Tensor  # (K,) int64 rows of the G-buffer
    pixels: ProbePixels  # (K) linear colours in the photo's exposure
    clipped: Tensor  # (K, 3) bool: the photo's white hides how bright the pixel was
    light_level: Tensor  # () radiance of the constant light that explains the photo's total luma
    overlap: float  # of the mask and the rasterised object, intersection over union
    offset: float  # between the centres of both, in object radii at the object's distance
    mask_mistake: str | None = None  # what the mask looks like where only that explains a small overlap

    def drawn(self, count: int, seed: int, stream: str) -> Tensor:
        """Return at most `count` indices (N,) int64 of trusted pixels, drawn from a named random stream."""
        every = torch.arange(len(self.rows), device=self.rows.device)
        return draw_rows(every, count, generator(seed, stream))


def observe(
    asset: Asset, pixels: Pixels, camera: Camera, device: torch.device, max_pixels: int
) -> Observation:
    """Return what `pixels` shows of the asset seen by a normalised-frame `camera`.

    The photo is reduced until about `max_pixels` of its pixels lie in the mask. Raises `InputError` when the
    photo and camera differ in size, the mask is empty, or the asset is out of view.
    """
    height, width = pixels.alpha.shape
    if (camera.width, camera.height) != (width, height):
        raise InputError(
            f"The photo has {width} x {height} pixels but its camera {camera.width} x {camera.height}; "
            "give the camera of this photo."
        )
    pixels = pixels.within(max_pixels)
    camera = camera.resized(pixels.alpha.shape[1], pixels.alpha.shape[0])
    gbuffer = rasterize_asset(asset, camera, device)
    cover = torch.from_numpy(pixels.alpha).to(device).reshape(-1)
    covered = cover[gbuffer.pixel]
    rows = (covered >= OPAQUE).nonzero()[:, 0]
    mask, shown = pixels.alpha >= _HALF, np.zeros(pixels.alpha.shape, bool)
    shown.flat[gbuffer.pixel.cpu().numpy()] = True
    agreement = overlap(mask, shown)
    mistake = _mistake(mask, shown) if agreement < SAME_PLACE else None
    if len(rows) < _FEWEST_PIXELS:
        advice = "check the pose and the mask." if mistake is None else mistake
        raise InputError(
            f"Only {len(rows)} pixels of the mask show the object as seen by this camera; {advice}"
        )
    at = gbuffer.pixel[rows]
    seen = probe_pixels(gbuffer, rows, torch.from_numpy(pixels.color).to(device).reshape(-1, 3)[at])
    hidden = torch.from_numpy(pixels.clipped).to(device).reshape(-1, 3)[at]
    offset = _offset(cover >= _HALF, gbuffer.pixel, camera)
    return Observation(gbuffer, rows, seen, hidden, seen.light_level(), agreement, offset, mistake)


def _mistake(mask: np.ndarray, shown: np.ndarray) -> str | None:
    """Return what is wrong with a mask (H, W) bool, and the remedy, where that alone keeps it off the object.

    shown (H, W) bool: the pixels of the object as the camera sees it.
    """
    turns = {90 * number: np.rot90(mask, -number) for number in (1, 2, 3)}
    told = "turned by {} degrees it would fit: `mogrify -rotate {} MASK` turns it, if the photo is upright."
    found = {
        "the mask looks inverted; the object must be white (or opaque) and all else black.": ~mask,
        "the mask looks mirrored: `mogrify -flop MASK` undoes it.": mask[:, ::-1],
        **{f"the mask lies on its side: {told.format(turn, turn)}": turns[turn] for turn in (90, 270)},
        f"the mask is upside down: {told.format(180, 180)}": turns[180],
    }
    fits = {sentence: overlap(other, shown) for sentence, other in found.items() if other.shape == mask.shape}
    best = max(fits, key=fits.__getitem__)
    return best if fits[best] >= SAME_PLACE else None


def _offset(mask: Tensor, pixel: Tensor, camera: Camera) -> float:
    """Return how far the centres of a mask (N,) bool and the object's pixels (P,) lie apart, normalised.

    This is the move across the view, of an object or a camera, that would bring one to the other.
    """
    centers = []
    for at in (mask.nonzero()[:, 0], pixel):  # on the image plane at distance 1
        column, row = at % camera.width, torch.div(at, camera.width, rounding_mode="floor")
        x, y = float(column.double().mean()) / camera.fx, float(row.double().mean()) / camera.fy
        centers.append(np.array([x, y]))
    return float(np.linalg.norm(centers[0] - centers[1]) * np.linalg.norm(camera.position))


def exposed(observation: Observation, exposure: Tensor) -> Observation:
    """Return the observation with its colours divided by `exposure` () > 0."""
    pixels = observation.pixels.photographed(observation.pixels.color / exposure)
    return replace(observation, pixels=pixels, light_level=pixels.light_level())


def joined(observations: Sequence[Observation]) -> Observation:
    """Return photos in one exposure as one observation, with the worst overlap and offset."""
    gbuffer = GBuffer.one_below_the_other([one.gbuffer.select(one.rows) for one in observations])
    pixels = ProbePixels.joined([one.pixels for one in observations])
    rows = torch.arange(len(pixels), device=gbuffer.pixel.device)
    clipped = torch.cat([one.clipped for one in observations])
    worst = min(observations, key=lambda one: one.overlap)
    offset = max(one.offset for one in observations)
    return Observation(
        gbuffer, rows, pixels, clipped, pixels.light_level(), worst.overlap, offset, worst.mask_mistake
    )


@torch.no_grad()
def relative_exposures(observations: Sequence[Observation], seed: int) -> Tensor:
    """Return the exposures (N,) of photos of one light relative to the first photo's; deterministic."""
    chosen = [one.drawn(_PIXELS, seed, f"exposures-{number}") for number, one in enumerate(observations)]
    gbuffers = [one.gbuffer.select(one.rows[some]) for one, some in zip(observations, chosen, strict=True)]
    matrices = [CoarseTransport.of(gbuffer) for gbuffer in gbuffers]
    colors = [one.pixels.color[some] for one, some in zip(observations, chosen, strict=True)]
    trusts = [
        relative_tone_weight(color, one.light_level)[:, None] * ~one.clipped[some]
        for one, some, color in zip(observations, chosen, colors, strict=True)
    ]
    every = CoarseTransport(torch.cat([one.matrix for one in matrices], 1))
    exposures = torch.ones(len(observations), device=every.matrix.device)
    for _ in range(_TURNS):
        color = torch.cat([color / s for color, s in zip(colors, exposures, strict=True)])
        light = every.solve(color, torch.cat(trusts), observations[0].light_level, (_STRENGTH,))[0]
        photos = zip(matrices, colors, trusts, strict=True)
        exposures = torch.stack([_exposure(one.matrix, color, trust, light) for one, color, trust in photos])
        exposures = exposures / exposures[0]
    return exposures


def _exposure(matrix: Tensor, color: Tensor, trust: Tensor, light: Tensor) -> Tensor:
    """Return the expected factor () that brings a photo under `light` (384, 3) closest to its `color` (P, 3).

    1 where no pixel is trusted, as in a photo that is white all over: it tells nothing of its exposure.
    """
    render = torch.einsum("cpt,tc->pc", matrix, light)
    explained = (trust * render.square()).sum().clamp(min=1e-12)
    ratio = ((trust * render * color).sum() / explained).clamp(1e-3, 1e3)
    # Of ln s about ln ratio. The asset's errors are alike over a whole photo: its pixels count as one.
    variance = (trust * (ratio * render - color).square()).sum() / (ratio.square() * explained)
    found = (ratio.log() * _SPREAD**2 / (_SPREAD**2 + variance)).exp()
    return torch.where(trust.any(), found, 1.0)

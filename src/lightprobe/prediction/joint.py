"""Several photos under one light, as one observation.

Notation: I_i the pixels of photo i, A_i their transport, s_i the photo's exposure relative to the first
one's, E the light in the exposure of the first photo: I_i = s_i A_i E. Divided by their exposures and put one
below the other, the photos are one larger photo, and everything that finds light in one photo finds it in all
of them together.

Exposures that are not known are found with the light: for given s the best coarse E is a linear solve, for
given E each s_i is a ratio, and the two are done in turn. Where photos look at different sides of a light,
hardly anything tells their exposures, and errors of the asset would; so a photo's ratio counts the more, the
better the light explains its pixels, against an expectation that the camera's settings were nearly the same.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from lightprobe.core.device import draw_rows, generator
from lightprobe.light.photometry import relative_tone_weight
from lightprobe.models.probe_pixels import ProbePixels
from lightprobe.prediction.observation import Observation
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.gbuffer import GBuffer

_PIXELS = 1024  # of each photo that exposures are found from
_STRENGTH = 0.03  # of the coarse light's pull to grey
_TURNS = 20  # of light and exposures; they settle to a thousandth in about ten
_SPREAD = 0.3  # expected of ln s where nothing is known


def exposed(observation: Observation, exposure: Tensor) -> Observation:
    """Return the observation with its colours divided by `exposure` () > 0."""
    pixels = observation.pixels.photographed(observation.pixels.color / exposure)
    return replace(observation, pixels=pixels, light_level=pixels.light_level())


def joined(observations: Sequence[Observation]) -> Observation:
    """Return one observation of the trusted pixels of photos in one exposure; overlap and offset are the
    worst.
    """
    gbuffer = GBuffer.one_below_the_other([one.gbuffer.select(one.rows) for one in observations])
    pixels = ProbePixels.joined([one.pixels for one in observations])
    rows, clipped = (
        torch.arange(len(pixels), device=gbuffer.pixel.device),
        [one.clipped for one in observations],
    )
    overlap, offset = min(one.overlap for one in observations), max(one.offset for one in observations)
    return Observation(gbuffer, rows, pixels, torch.cat(clipped), pixels.light_level(), overlap, offset)


@torch.no_grad()
def relative_exposures(observations: Sequence[Observation], seed: int) -> Tensor:
    """Return the exposures (N,) of photos of one light relative to the first photo's; deterministic."""
    chosen = [_subset(one, number, seed) for number, one in enumerate(observations)]
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
        exposures = torch.stack(
            [
                _exposure(one.matrix, color, trust, light)
                for one, color, trust in zip(matrices, colors, trusts, strict=True)
            ]
        )
        exposures = exposures / exposures[0]
    return exposures


def _subset(observation: Observation, number: int, seed: int) -> Tensor:
    every = torch.arange(len(observation.rows), device=observation.rows.device)
    return draw_rows(every, _PIXELS, generator(seed, f"exposures-{number}"))


def _exposure(matrix: Tensor, color: Tensor, trust: Tensor, light: Tensor) -> Tensor:
    """Return the expected factor () that brings a photo under `light` (384, 3) closest to its pixels `color`
    (P, 3).

    1 where no pixel is trusted, as in a photo that is white all over: it tells nothing of its exposure.
    """
    render = torch.einsum("cpt,tc->pc", matrix, light)
    explained = (trust * render.square()).sum().clamp(min=1e-12)
    ratio = ((trust * render * color).sum() / explained).clamp(1e-3, 1e3)
    # Of ln s about ln ratio. The asset's errors are alike over a whole photo: its pixels count as one.
    variance = (trust * (ratio * render - color).square()).sum() / (ratio.square() * explained)
    found = (ratio.log() * _SPREAD**2 / (_SPREAD**2 + variance)).exp()
    return torch.where(trust.any(), found, 1.0)

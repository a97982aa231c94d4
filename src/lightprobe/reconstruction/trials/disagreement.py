"""Whether halves of an object agree about a photo's light: evidence on the material that needs no truth.

A light solved from all pixels of a photo, held out or not, bends to whatever the surface is taken for. A
light solved from half of the pixels cannot bend to the other half. Reflections that do not take the surface's
colour weigh more on dark surfaces than on bright ones: a surface that is taken for too bright asks for too
dim a light where it is bright and for the right light where it is dark, and neither half explains the other.

Half the pixels tell less of the light than all of them, and how much less depends on the surface, too: a dark
surface shows more of its light. So the halves are also compared on a photo that the surface explains in full,
its rendering under the light of all pixels; what counts is by how much they explain each other worse than
there.
"""

import itertools
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.light import prefilter as prefilters
from lightprobe.light.photometry import displayed_error
from lightprobe.reconstruction.lights import solve_through
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade_under
from lightprobe.render.transport import Transport

SPLITS = 2  # ways of halving the pixels: dark and bright, and at random
_SOLVES = 3  # of a half's light, which starts grey: one that knows the other half would tell nothing
_FEWEST_PIXELS = 32  # of a photo that can be halved


@dataclass(frozen=True)
class _Half:
    """Some of a photo's pixels, `rows` (K,) int64, and what they show of a light."""

    rows: Tensor
    transport: Transport


@torch.no_grad()
def disagreement(
    pixels: GBuffer,
    observed: Tensor,
    clipped: Tensor,
    light: Tensor,
    config: DecomposeConfig,
    random: torch.Generator,
) -> Tensor | None:
    """Return by how much each half of P pixels fails to explain the other, (SPLITS,) float64; None for too
    few.

    It is the root of the squared displayed error of each half under the light of the other, less the same in
    a photo which the surface explains. The halves are the darker and the brighter surfaces, and two at
    random. observed (P, 3): linear colours in a photo; clipped (P, 3) bool; light (6, R, R, 3): the one that
    explains all pixels.
    """
    count = len(pixels.pixel)
    if count < _FEWEST_PIXELS:
        return None
    chance = torch.randperm(count, generator=random).to(light.device)
    # Equally bright surfaces are in an order of chance.
    dark_first = chance[pixels.base_color.mean(1)[chance].argsort(stable=True)]
    operator = prefilters.cached(light.shape[1], light.device)
    explained, unclipped = shade_under(pixels, light), torch.zeros_like(clipped)
    found = []
    for order in (dark_first, chance):
        halves = [
            _Half(rows, Transport(pixels, operator, rows, often=True)) for rows in order.tensor_split(2)
        ]
        measured, expected = (
            sum(_error(*photo, light, config, *way) for way in itertools.permutations(halves))
            for photo in ((observed, clipped), (explained, unclipped))
        )
        found.append(max(measured**2 - expected**2, 0.0) ** 0.5 / 2)
    return torch.tensor(found, dtype=torch.float64)


def _error(
    observed: Tensor, clipped: Tensor, light: Tensor, config: DecomposeConfig, half: _Half, rest: _Half
) -> float:
    """Return the displayed error of the rest under a light solved from a half, from `light`'s mean colour."""
    start = light.mean((0, 1, 2)).expand_as(light).contiguous()
    found = solve_through(half.transport, observed[half.rows], clipped[half.rows], start, config, _SOLVES)
    return float(displayed_error(rest.transport.apply(found), observed[rest.rows], clipped[rest.rows]))

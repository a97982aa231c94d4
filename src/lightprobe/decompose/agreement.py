"""Whether parts of an object agree about their light: evidence on the material that needs no truth.

A light solved from all pixels of a photo bends to whatever the surface is taken for, and so does one that is solved
for a held-out photo. One that is solved from a part of the pixels cannot bend to the others. Reflections that do not
take the surface's colour weigh more on dark surfaces than on bright ones: a surface that is taken for too bright asks
for too dim a light where it is bright and for the right one where it is dark, and neither part explains the other.
"""

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.decompose.lights import solve_target_light
from lightprobe.decompose.losses import one_sided, tone_map
from lightprobe.light import prefilter as prefilters
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade

SPLITS = 2
_SOLVES = 3  # of a part's light; from a light that knows the other part, too, fewer would do and tell nothing
_FEWEST_PIXELS = 32


@torch.no_grad()
def disagreement(
    pixels: GBuffer, observed: Tensor, clipped: Tensor, light: Tensor, config: DecomposeConfig, random: torch.Generator
) -> Tensor | None:
    """Return the mean displayed error (SPLITS,) float64 of each half of the pixels under the light of the other half.

    The halves are the darker and the brighter surfaces, and two at random. observed (P, 3): linear colours of the P
    pixels in a photo; clipped (P, 3) bool; light (6, R, R, 3): a guess, of which only the mean colour counts. None for
    too few pixels.
    """
    count = len(pixels.pixel)
    if count < _FEWEST_PIXELS:
        return None
    flat = light.mean((0, 1, 2)).expand_as(light).contiguous()
    chance = torch.randperm(count, generator=random).to(light.device)
    orders = (chance[pixels.base_color.mean(1)[chance].argsort(stable=True)], chance)  # equally bright ones by chance
    errors = torch.zeros(SPLITS, dtype=torch.float64)
    for i, order in enumerate(orders):
        for part, rest in (order.tensor_split(2), reversed(order.tensor_split(2))):
            found = flat
            for _ in range(_SOLVES):
                found = solve_target_light(observed[part], clipped[part], pixels, found, part, config)
            errors[i] += 0.5 * displayed_error(pixels.select(rest), observed[rest], clipped[rest], found)
    return errors


def displayed_error(pixels: GBuffer, observed: Tensor, clipped: Tensor, light: Tensor) -> float:
    """Return the mean absolute tone-mapped error of pixels under a light (6, R, R, 3); arguments as above."""
    operator = prefilters.cached(light.shape[1], light.device)
    render = one_sided(shade(pixels, operator, operator.apply(light)), observed, clipped)
    return float((tone_map(render) - tone_map(observed)).abs().mean())

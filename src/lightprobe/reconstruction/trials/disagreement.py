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

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.light.photometry import displayed_error
from lightprobe.reconstruction.lights import LightSolver
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade_under

SPLITS = 2  # ways of halving the pixels: dark and bright, and at random
_SOLVES = 3  # of a half's light, which starts grey: one that knows the other half would tell nothing
_FEWEST_PIXELS = 32  # of a photo that can be halved


def part_solver(config: DecomposeConfig, device: torch.device, pixels: int) -> LightSolver:
    """Return what finds the lights of halves of up to `pixels` pixels, for `disagreement`."""
    return LightSolver(config, device, pixels, _SOLVES)


@torch.no_grad()
def disagreement(
    pixels: GBuffer,
    observed: Tensor,
    clipped: Tensor,
    light: Tensor,
    solver: LightSolver,
    random: torch.Generator,
) -> Tensor | None:
    """Return by how much each half of P pixels fails to explain the other, (SPLITS,) float64; None for too
    few.

    It is the root of the squared displayed error of each half under the light of the other, less the same in
    a photo which the surface explains. The halves are the darker and the brighter surfaces, and two at
    random. observed (P, 3): linear colours in a photo; clipped (P, 3) bool; light (6, R, R, 3): the one that
    explains all pixels; solver: a `part_solver` for half of the pixels, rounded up.
    """
    count = len(pixels.pixel)
    if count < _FEWEST_PIXELS:
        return None
    chance = torch.randperm(count, generator=random).to(light.device)
    # Equally bright surfaces are in an order of chance.
    dark_first = chance[pixels.base_color.mean(1)[chance].argsort(stable=True)]
    explained, unclipped = shade_under(pixels, light), torch.zeros_like(clipped)
    found = []
    for order in (dark_first, chance):
        first, second = order.tensor_split(2)
        measured, expected = (
            sum(_error(pixels, *photo, light, solver, *way) for way in ((first, second), (second, first)))
            for photo in ((observed, clipped), (explained, unclipped))
        )
        found.append(max(measured**2 - expected**2, 0.0) ** 0.5 / 2)
    return torch.tensor(found, dtype=torch.float64)


def _error(
    pixels: GBuffer,
    observed: Tensor,
    clipped: Tensor,
    light: Tensor,
    solver: LightSolver,
    half: Tensor,
    rest: Tensor,
) -> float:
    """Return the displayed error of the rest under a light solved from a half, from `light`'s mean colour."""
    start = light.mean((0, 1, 2)).expand_as(light).contiguous()
    found = solver(observed, clipped, pixels, half, start)
    return float(displayed_error(shade_under(pixels.select(rest), found), observed[rest], clipped[rest]))

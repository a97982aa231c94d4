"""Stacking of probe pixels onto a whole map without visiting every (pixel, texel) pair.

A lobe is sharp near its peak and its horizon and smooth everywhere else. So the map is cut into tiles and
each tile into quarters, down to 4 x 4 texels, and a pixel goes down this tree only where its lobe demands it:

    tile below the pixel's horizon        nothing
    lobe smooth over the tile             its values at 4 x 4 Chebyshev nodes are added to the tile's sums
    the quarters are the last             its values at all their texels are added, exact
    else                                  on to the four quarters

When all pixels are in, every tile hands its sums down by cubic interpolation, to the nodes of its quarters
and in the end to texels. Interpolation is linear, so it is done once for all pixels, and both sums of
Equation 5 go the same way.

**Error.** With the components k, s of the half vector (`kernels.stacking.lobe_frames`) the only singularities of the
lobe, as a function of a complex position, lie where k + a2 s^2 = 0. Both terms are squares of lengths that
change no faster than w does, so the nearest is at least d = sqrt(k + a2 s^2) away. The lobe counts as smooth
over a tile of radius q if d >= `SEPARATION` q. Interpolation at n Chebyshev nodes in an interval of half
length q / sqrt 2 converges as rho^-n, where rho, the sum of the half axes of the ellipse through the
singularity, is 8.4 here, and n = 4. This error is relative to the lobe's own size on the tile, so it holds
for every mixture of lobes, and also in directions that are hardly seen. W and P are within `ERROR` of the
exact sums in relative L2; the worst seen, among few pixels chosen to provoke it, is .6 of that.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.kernels import dispatch
from lightprobe.kernels.stacking import LEAST_ALPHA2, lobe_frames

ERROR = 1e-3  # relative L2
SEPARATION = 3.0  # least distance of a lobe's singularity, in radii of the tile
SIDE = 4  # nodes, or texels at the bottom, along each edge of a tile
NODES = SIDE * SIDE
STEPS_PER_PIXEL = 20_000  # nanoseconds or so, with all roots


@dataclass(frozen=True)
class TileTree:
    """The tiles of a map of M texels: G roots of T tiles each; tile i has the quarters 4 i + 1 .. 4 i + 4.

    A root has at least its quarters, T >= 5. Raises ValueError where it has none.
    """

    tiles: np.ndarray
    """(G, T, 7 * 16) float32: x, y, z of the nodes or texels, then zeros for W and the three sums."""
    bounds: np.ndarray
    """(G, T, 4) float32: centre, and the largest distance from it."""
    maps: np.ndarray
    """(2, 4, 16, 16) float32: from a tile's nodes (third) to those of each quarter, or to its texels."""
    texels: np.ndarray
    """(G, leaves, 16) int64: flat index in [0, M) of the texels of the last quarters, each once."""

    def __post_init__(self) -> None:
        """Raise `ValueError` for roots without quarters, which no loop asks about before it goes down."""
        if self.bounds.shape[1] < 5:
            raise ValueError("every root of a tree of tiles must have its quarters: the map is too small")


def stack_probes_culled(
    colors: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, tree: TileTree
) -> tuple[Tensor, Tensor]:
    """Return radiance P (M, 3) and weight W (M,) of `stack_probes` at the texels of `tree`; not differentiable.

    colors, normals, views (N, 3), alpha2 (N,) in (0, 1]: float32 on the CPU; vectors of unit length. Within
    `ERROR` of the exact sums. Faster when neighbouring pixels are alike. The bits do not depend on the number
    of threads.
    """
    alpha2 = alpha2.detach().clamp(min=LEAST_ALPHA2)
    scale = alpha2[:, None] / math.pi
    factors = torch.cat([scale, scale * colors.detach()], dim=1)
    frames = lobe_frames(normals.detach(), views.detach(), alpha2)
    weight, radiance = factors.new_empty(tree.texels.size), factors.new_empty(tree.texels.size, 3)
    loops = dispatch.compiled_loops("culled_stacking", len(colors) * STEPS_PER_PIXEL)
    pixels = frames.contiguous().numpy(), factors.contiguous().numpy()
    tiles, texels = tree.tiles.copy(), (weight.numpy(), radiance.numpy())
    loops.stack(*pixels, tree.bounds, tree.maps, tree.texels, tiles, *texels)
    return radiance, weight

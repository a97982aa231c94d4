"""A scalar on the vertices of a lattice as the sum of coarse grids, beside one free value per vertex.

Adam moves every value by about its rate, however small its gradient. On single lattice vertices the noise of
shading is then as strong as what many vertices agree on; a value of a coarse grid moves its surroundings
together by what they agree on (the idea of preconditioned shape gradients: Nicolet et al. 2021, "Large Steps
in Inverse Rendering").
"""

import math

import torch
from torch import Tensor, nn

from lightprobe.geometry.tet_lattice import TetLattice

_FINEST = 4  # lattice cells between the values of the finest grid; each further grid has twice the spacing


class CoarseGrids(nn.Module):
    """Grids around a lattice, interpolated linearly; all values start at zero."""

    place: Tensor

    def __init__(self, lattice: TetLattice, levels: int):
        super().__init__()
        grid = ((lattice.vertices - lattice.vertices.min(0).values) / lattice.cell).round().long()
        self.size = [int(n) for n in grid.max(0).values + 1]
        self.register_buffer("place", (grid[:, 0] * self.size[1] + grid[:, 1]) * self.size[2] + grid[:, 2])
        self.tents = [[_tents(n, _FINEST * 2**k, grid.device) for n in self.size] for k in range(levels)]
        self.values = nn.ParameterList(
            torch.zeros([axis.shape[1] for axis in axes], device=grid.device) for axes in self.tents
        )

    def forward(self) -> Tensor:
        """Return the sum of the grids at the lattice's vertices, (V,)."""
        total = torch.zeros(self.size, device=self.place.device)
        for values, (x, y, z) in zip(self.values, self.tents, strict=True):
            slices = y @ (values @ z.T)
            total = total + (x @ slices.flatten(1)).reshape(self.size)
        return total.reshape(-1).index_select(0, self.place)


def _tents(count: int, spacing: int, device: torch.device) -> Tensor:
    """Return the matrix (count, M) that interpolates M values, one at every `spacing`-th place, at all
    places.
    """
    values = torch.arange(math.ceil((count - 1) / spacing) + 1, device=device)
    return (1 - (torch.arange(count, device=device)[:, None] / spacing - values).abs()).clamp(min=0)

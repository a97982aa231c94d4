"""Representations of signed distance on a lattice, V vertices: a network of position, or coarse grids."""

import itertools
import math

import torch
from torch import Tensor, nn

from lightprobe.core.device import to_device
from lightprobe.geometry.tet_lattice import TetLattice
from lightprobe.training import Descent, ParameterGroup

_FITTED = 16_384  # points at most in a step that fits the network of distances to a shape
_FINEST = 4  # lattice cells between the values of the finest grid; each further grid has twice the spacing
_GRIDS = 2


class DistanceMlp(nn.Module):
    """The paper's: an MLP of encoded position, with three hidden layers of 64."""

    scales: Tensor

    def __init__(self, random: torch.Generator):
        super().__init__()
        self.register_buffer("scales", 2.0 ** torch.arange(6) * torch.pi)
        widths = (3 + 36, 64, 64, 64, 1)
        self.weights = nn.ParameterList(
            torch.randn(a, b, generator=random) * (2 / a) ** 0.5 for a, b in itertools.pairwise(widths)
        )
        self.biases = nn.ParameterList(torch.zeros(b) for b in widths[1:])

    def forward(self, points: Tensor) -> Tensor:
        """Return distances (V,) at points (V, 3)."""
        angles = (points[:, :, None] * self.scales).flatten(1)
        x = torch.cat([points, torch.sin(angles), torch.cos(angles)], 1)
        for weight, bias in zip(list(self.weights)[:-1], list(self.biases)[:-1], strict=True):
            x = torch.nn.functional.softplus(torch.addmm(bias, x, weight), beta=100)
        return torch.addmm(self.biases[-1], x, self.weights[-1])[:, 0]

    def fit(self, points: Tensor, distance: Tensor, steps: int, random: torch.Generator) -> None:
        """Fit the network to distances (V,) given at points (V, 3), so that training starts from a shape."""
        descent = Descent(
            [ParameterGroup(dict(self.named_parameters()), rate=1e-3)],
            lambda some: (self(points[some]) - distance[some]).abs().mean(),
        )
        count = min(_FITTED, len(points))
        for step in range(steps):
            rows = torch.randint(0, len(points), (count,), generator=random)
            descent.step(step, to_device(rows, points.device))
        descent.end()


class CoarseGrids(nn.Module):
    """A scalar on the vertices of a lattice as the sum of coarse grids, beside one free value per vertex.

    Adam moves every value by about its rate, however small its gradient. On single lattice vertices the noise
    of shading is then as strong as what many vertices agree on; a value of a coarse grid moves its
    surroundings together by what they agree on (the idea of preconditioned shape gradients: Nicolet et al.
    2021, "Large Steps in Inverse Rendering"). The grids are interpolated linearly; all values start at zero.
    """

    place: Tensor

    def __init__(self, lattice: TetLattice):
        super().__init__()
        grid = ((lattice.vertices - lattice.vertices.min(0).values) / lattice.cell).round().long()
        self.size = [int(n) for n in grid.max(0).values + 1]
        self.register_buffer("place", (grid[:, 0] * self.size[1] + grid[:, 1]) * self.size[2] + grid[:, 2])
        self.tents = [[_tents(n, _FINEST * 2**k, grid.device) for n in self.size] for k in range(_GRIDS)]
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
    """Return the matrix (count, M) that interpolates M values, one at every `spacing`-th of `count` places."""
    values = torch.arange(math.ceil((count - 1) / spacing) + 1, device=device)
    return (1 - (torch.arange(count, device=device)[:, None] / spacing - values).abs()).clamp(min=0)

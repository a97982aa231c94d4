"""The material as a function of position: a multiresolution hash grid read by a small MLP.

Output channels, in this order everywhere (`CHANNELS`): base colour 3 (linear), roughness, metallic, normal
offset 3. The normal offset is added to the interpolated unit normal and the sum normalised; it is in world
axes, because a lattice surface has no texture coordinates yet. Baking turns it into a tangent-space normal
map.
"""

import itertools

import torch
from torch import Tensor, nn

from lightprobe.kernels import hash_encode

CHANNELS = 8  # base colour 3, roughness, metallic, normal offset 3
MIN_ROUGHNESS = 0.08  # the prefilter's least
START_BASE = 0.2  # linear base colour that a new field shows
MAX_NORMAL_OFFSET = 0.5  # of each component, before the normal is normalised


def activate(raw: Tensor) -> Tensor:
    """Map unbounded channels (N, 8) to a valid material (N, 8)."""
    color = torch.sigmoid(raw[:, :3])
    roughness = MIN_ROUGHNESS + (1 - MIN_ROUGHNESS) * torch.sigmoid(raw[:, 3:4])
    metallic = torch.sigmoid(raw[:, 4:5])
    offset = MAX_NORMAL_OFFSET * torch.tanh(raw[:, 5:8])
    return torch.cat([color, roughness, metallic, offset], dim=1)


def level_resolutions(levels: int, coarsest: int, finest: int) -> Tensor:
    """Return the cells per edge of each level, (L,) int32, in geometric progression (Mueller et al. 2022, eq.
    2-3).
    """
    steps = torch.arange(levels, dtype=torch.float64) / max(levels - 1, 1)
    return torch.floor(coarsest * (finest / coarsest) ** steps + 1e-6).to(torch.int32)


class MaterialField(nn.Module):
    """Hash grid and MLP (two hidden layers of 32) from points to materials."""

    def __init__(
        self,
        *,
        levels: int,
        features: int,
        log2_size: int,
        finest: int,
        extent: float,
        generator: torch.Generator,
        coarsest: int = 12,
    ) -> None:
        """`extent`: half edge of the cube around the origin that the grid covers, in normalised units."""
        super().__init__()
        self.extent = extent
        # No buffer: its values are read, which a GPU delays.
        self.resolutions = level_resolutions(levels, coarsest, finest)
        self.table = nn.Parameter(
            torch.rand(levels, 2**log2_size, features, generator=generator) * 2e-4 - 1e-4
        )
        widths = (levels * features + 3, 32, 32, CHANNELS)
        self.weights = nn.ParameterList(
            torch.randn(a, b, generator=generator) * (2 / a) ** 0.5 for a, b in itertools.pairwise(widths)
        )
        self.biases = nn.ParameterList(torch.zeros(b) for b in widths[1:])
        with torch.no_grad():
            self.weights[-1].mul_(0.1)
            # Start a dark grey, half rough and a third metallic, from where either kind of surface can be
            # reached.
            self.biases[-1].copy_(torch.tensor([-1.4, -1.4, -1.4, 0.0, -0.85, 0.0, 0.0, 0.0]))

    def forward(self, points: Tensor) -> Tensor:
        """Return the material (N, 8) at points (N, 3) of the normalised frame; differentiable in the points,
        too.
        """
        unit = (points / (2 * self.extent) + 0.5).clamp(0, 1)
        features = hash_encode(unit, self.table, self.resolutions)
        x = torch.cat([features, unit - 0.5], dim=1)
        for weight, bias in zip(list(self.weights)[:-1], list(self.biases)[:-1], strict=True):
            x = torch.relu(torch.addmm(bias, x, weight))
        return activate(torch.addmm(self.biases[-1], x, self.weights[-1]))

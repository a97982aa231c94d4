"""Prefiltering of a cubemap as one constant linear operator.

The light enters a render as its average under the lobe of a direction and a roughness (`light.lobes`). These averages
are tabulated on *levels*: cubemaps of one roughness each, stacked flat into one tensor (T, 3). As the lobes are
constant, levels = L P env with P the pyramid of area averages of the light and L the lobes over its nodes, both sparse;
every row of the product sums to 1, so a constant light gives constant levels. The roughnesses lie linearly from 0.08 to
0.5 and the last is 1, whose lobe is a cosine: that level also serves as irradiance / pi.
"""

import functools
import math
from dataclasses import dataclass
from typing import Any

import scipy.sparse
import torch
from torch import Tensor

from lightprobe.core.errors import ConfigError
from lightprobe.light import cubemap, lobes
from lightprobe.light.sparse import SparseOperator

MIN_ROUGHNESS = 0.08
ROUGHNESSES = (0.08, 0.14, 0.20, 0.26, 0.32, 0.38, 0.44, 0.50, 1.0)
_TEXELS_PER_WIDTH = 2.5  # a level resolves the half width of its lobe by about so many texels
_COARSEST = 16  # no level of a finer light is coarser: it would show in smooth gradients


@dataclass(frozen=True)
class Level:
    """One stacked level: its roughness, face resolution and first row in the stack."""

    roughness: float
    resolution: int
    offset: int


def plan_levels(resolution: int, roughnesses: tuple[float, ...] = ROUGHNESSES) -> tuple[Level, ...]:
    """Return the levels for lights of `resolution`: fine where the lobe is narrow, coarser as it widens."""
    levels, offset = [], 0
    for roughness in roughnesses:
        wanted = _TEXELS_PER_WIDTH * 0.5 * math.pi / (2.0 * roughness**2)
        size = max(_COARSEST, 2 ** math.ceil(math.log2(wanted)))
        if roughness < 1.0:
            size = min(size, resolution)
        levels.append(Level(roughness, size, offset))
        offset += 6 * size * size
    return tuple(levels)


def _stacked_index(level: Level, device: torch.device) -> Tensor:
    """Return the level's `cubemap.bordered_index` with indices into the whole stack."""
    index = cubemap.bordered_index(level.resolution, device)
    return torch.where(index < 0, index, index + level.offset)


class _Apply(torch.autograd.Function):
    """levels = L P env, whose gradient is the adjoint."""

    @staticmethod
    def forward(ctx: Any, env: Tensor, prefilter: "Prefilter") -> Tensor:
        ctx.prefilter = prefilter
        return prefilter.lobes.apply(prefilter.pyramid.apply(env.reshape(-1, 3)))

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return ctx.prefilter.adjoint(gradient), None


class Prefilter:
    """The prefilter operator for cubemaps of one resolution (a power of two from 4); use `cached` to share it."""

    def __init__(self, resolution: int, device: torch.device | str = "cpu", *, tolerance: float = lobes.TOLERANCE):
        if resolution < 4 or resolution & (resolution - 1):
            raise ConfigError(f"The light resolution must be a power of two from 4, not {resolution}.")
        self.resolution = resolution
        self.levels = plan_levels(resolution)
        self.total = self.levels[-1].offset + 6 * self.levels[-1].resolution ** 2
        rows = [
            lobes.lobe_matrix(
                cubemap.directions(level.resolution).reshape(-1, 3), level.roughness**2, resolution, tolerance
            )
            for level in self.levels
        ]
        self.lobes = SparseOperator.build(scipy.sparse.csr_array(scipy.sparse.vstack(rows, format="csr")), device)
        self.pyramid = SparseOperator.build(lobes.pyramid_matrix(resolution), device)
        self._nodes = torch.tensor([level.roughness for level in self.levels], device=device)
        self._resolutions = torch.tensor([level.resolution for level in self.levels], device=device)
        tables = [_stacked_index(level, torch.device(device)) for level in self.levels]
        self._starts = torch.tensor([0, *(len(table) for table in tables[:-1])], device=device).cumsum(0)
        self._table = torch.cat(tables)

    def apply(self, env: Tensor) -> Tensor:
        """Return the stacked levels (T, 3) of the cubemap env (6, R, R, 3); differentiable in env."""
        self._check(env)
        return _Apply.apply(env, self)

    def adjoint(self, levels: Tensor) -> Tensor:
        """Return the transpose of `apply`, (6, R, R, 3), on levels (T, 3); no gradient of its own."""
        gradient = self.pyramid.adjoint(self.lobes.adjoint(levels))
        return gradient.reshape(6, self.resolution, self.resolution, 3)

    def specular_taps(self, direction: Tensor, roughness: Tensor) -> tuple[Tensor, Tensor]:
        """Return index (N, 8) int32 into the levels and weight (N, 8) for lobes around `direction`.

        direction (N, 3), roughness (N,): bilinear within two levels, linear in roughness between them. Weights sum to 1
        and are differentiable in both arguments; roughness is clamped to [0.08, 1].
        """
        level, fraction = self._level(roughness)
        coordinates = cubemap.face_coordinates(direction)
        below, above = (
            cubemap.bordered_taps(coordinates, self._resolutions[k], self._starts[k], self._table)
            for k in (level, level + 1)
        )
        fraction = fraction[:, None]
        return torch.cat([below[0], above[0]], -1), torch.cat([(1.0 - fraction) * below[1], fraction * above[1]], -1)

    def diffuse_taps(self, normal: Tensor) -> tuple[Tensor, Tensor]:
        """Return index (N, 4) int32 and weight (N, 4) that look up irradiance / pi around normals (N, 3)."""
        level = self.levels[-1]
        index, weight = cubemap.bilinear_taps(normal, level.resolution)
        return index + level.offset, weight

    def _level(self, roughness: Tensor) -> tuple[Tensor, Tensor]:
        """Return the level below each roughness (int64) and the fraction (differentiable) towards the next."""
        nodes = self._nodes.to(roughness.dtype)
        roughness = roughness.clamp(MIN_ROUGHNESS, 1.0)
        level = (torch.searchsorted(nodes, roughness.detach().contiguous(), right=True) - 1).clamp(0, len(nodes) - 2)
        return level, (roughness - nodes[level]) / (nodes[level + 1] - nodes[level])

    def _check(self, env: Tensor) -> None:
        size = self.resolution
        if env.shape != (6, size, size, 3):
            raise ConfigError(f"This prefilter takes cubemaps (6, {size}, {size}, 3), not {tuple(env.shape)}.")


@functools.lru_cache(maxsize=8)
def cached(resolution: int, device: torch.device | str = "cpu") -> Prefilter:
    """Return the process's shared prefilter of a resolution and device; building one takes seconds at R = 128."""
    return Prefilter(resolution, device)

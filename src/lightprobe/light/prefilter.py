"""Prefiltering of a cubemap as one constant linear operator.

The light enters a render as its average under the lobe of a direction and a roughness (`light.lobes`). These
averages are tabulated on *levels*: cubemaps of one roughness each, stacked flat into one tensor (T, 3). As
the lobes are constant, levels = L N env with N averages of the light over nodes and L the lobes over the
nodes, both sparse; every row of the product sums to 1, so a constant light gives constant levels. At
roughness 1 the lobe is a cosine: that level also serves as irradiance / pi. The last level goes on to lobes
flatter than a cosine, as the roughest surfaces have them (`render.specular_lobes`).

Below the levels come the *blocks*: the light averaged over each of 6 x 8 x 8 parts of the sphere, for what
depends on the direction in a coarse way, such as the object's shadows.

Between two levels the lobe is interpolated linearly in 1 / alpha, which follows its peak. The roughnesses are
a ladder on which, in the L2 norm, an interpolated lobe is at most 4 % off the true one, or 7 % below 0.15.
(Nine levels linear in r from 0.08 to 0.5 with a last one at 1, and look-ups linear in r, are the common
choice; there it is 38 % off below 0.14 and 31 % between 0.5 and 1.)
"""

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
import torch
from torch import Tensor

from lightprobe.core.errors import ConfigError
from lightprobe.light import cubemap
from lightprobe.light.lobes import Nodes, Orbits, narrow_rows, unfold, wide_rows
from lightprobe.light.sparse import ChosenRows, SparseOperator

# Tabulated roughnesses exceed 1, as the specular mixture's lobes may be wider than a cosine.
MIN_ROUGHNESS, MAX_ROUGHNESS = 0.08, 1.4
BLOCKS = 8  # blocks along each edge of the cubemap: about ten degrees
ROUGHNESSES = (0.08, 0.11, 0.15, 0.19, 0.24, 0.305, 0.39, 0.5, 0.67, 1.0, MAX_ROUGHNESS)
_TEXEL = 0.5 * math.pi  # mean extent of the texel of a cubemap with R = 1, in radians
_TEXELS_PER_WIDTH = 1.8  # texels of a level in the half width of its lobe, at least, where the light has them
_SMALLEST_WIDTH = 0.4  # texels of the light: levels of narrower lobes are left out, but for the first
_COARSEST = 16  # no level of a finer light is coarser: it would show in smooth gradients


@dataclass(frozen=True)
class Level:
    """One stacked level: its roughness, face resolution and first row in the stack."""

    roughness: float
    resolution: int
    offset: int


@dataclass(frozen=True)
class Accuracy:
    """How finely lobes are integrated."""

    tolerance: float  # see `lobes.narrow_rows`
    tent_resolution: int  # coarse grid for wide lobes
    wide: float  # least roughness of a wide lobe


DRAFT = Accuracy(0.1, 8, 0.5)
"""For frequent, rough use of a light: half the entries of narrow lobes; renders differ by .1 to .2 %."""


def accuracy_for(resolution: int) -> Accuracy:
    """Return the accuracy for lights of `resolution`: small ones must be fast, and are blurred anyway."""
    return Accuracy(0.01, 8, 0.5) if resolution <= 32 else Accuracy(0.01, 16, 0.35)


def plan_levels(resolution: int) -> tuple[Level, ...]:
    """Return the levels for lights of `resolution`: fine where the lobe is narrow, coarser as it widens."""
    levels, offset = [], 0
    for roughness in ROUGHNESSES:
        width = 2.0 * roughness**2
        if roughness > MIN_ROUGHNESS and width < _SMALLEST_WIDTH * _TEXEL / resolution:
            continue
        size = max(_COARSEST, 2 ** math.ceil(math.log2(_TEXELS_PER_WIDTH * _TEXEL / width)))
        if roughness < 1.0:
            size = min(size, resolution)
        levels.append(Level(roughness, size, offset))
        offset += 6 * size * size
    return tuple(levels)


def _lobe_matrix(levels: tuple[Level, ...], nodes: Nodes, accuracy: Accuracy) -> scipy.sparse.csr_array:
    """Return the rows of all levels, one below the other; float32, unsorted."""
    orbits = {resolution: Orbits.of(resolution) for resolution in {level.resolution for level in levels}}
    rows, which, by, count = [], [], [], 0
    for level in levels:
        orbit, alpha = orbits[level.resolution], level.roughness**2
        directions = cubemap.exact_directions(level.resolution).reshape(-1, 3).numpy()[orbit.first]
        if level.roughness < accuracy.wide:
            rows.append(narrow_rows(directions, alpha, nodes, accuracy.tolerance))
        else:
            rows.append(wide_rows(directions, alpha, nodes))
        which.append(orbit.which + count)
        by.append(orbit.by)
        count += len(directions)
    first = scipy.sparse.csr_array(scipy.sparse.vstack(rows, format="csr"), dtype=np.float32)
    return unfold(first, np.concatenate(which), np.concatenate(by), nodes.sources())


def _block_matrix(resolution: int) -> scipy.sparse.csr_array:
    """Return averages over blocks (384, 6 R^2) by solid angle; a coarse light is constant in each texel."""
    fine = max(resolution, BLOCKS)
    centres = cubemap.exact_directions(fine).reshape(-1, 3)
    block, texel = cubemap.nearest_texel(centres, BLOCKS), cubemap.nearest_texel(centres, resolution)
    angle = cubemap.exact_solid_angles(fine).reshape(-1)
    share = angle / torch.zeros(6 * BLOCKS**2, dtype=angle.dtype).index_add(0, block, angle)[block]
    entries = (share.numpy(), (block.numpy(), texel.numpy()))
    return scipy.sparse.coo_array(entries, shape=(6 * BLOCKS**2, 6 * resolution**2)).tocsr()


class _Apply(torch.autograd.Function):
    """The levels L N env and the blocks of env, whose gradient is the adjoint."""

    @staticmethod
    def forward(ctx: Any, env: Tensor, prefilter: "Prefilter") -> Tensor:
        ctx.prefilter = prefilter
        return prefilter.averages(env, prefilter.lobes)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return ctx.prefilter.adjoint(gradient), None


class Prefilter:
    """The prefilter operator for cubemaps of one resolution, a power of two from 4; `cached` shares it."""

    def __init__(self, resolution: int, device: torch.device | str = "cpu", accuracy: Accuracy | None = None):
        if resolution < 4 or resolution & (resolution - 1):
            raise ConfigError(f"The light resolution must be a power of two from 4, not {resolution}.")
        self.resolution = resolution
        self.levels = plan_levels(resolution)
        self.first_block = self.levels[-1].offset + 6 * self.levels[-1].resolution ** 2
        self.total = self.first_block + 6 * BLOCKS**2
        self._cosine = next(level for level in self.levels if level.roughness == 1.0)
        accuracy = accuracy or accuracy_for(resolution)
        nodes = Nodes(resolution, min(resolution, accuracy.tent_resolution))
        self.nodes = SparseOperator.build(nodes.matrix(), device)
        self.lobes = SparseOperator.build(_lobe_matrix(self.levels, nodes, accuracy), device)
        self.blocks = SparseOperator.build(_block_matrix(resolution), device)
        self._sharpness = torch.tensor([level.roughness**-2 for level in self.levels], device=device)
        tables = []  # `cubemap.cells` of each level, with indices into the whole stack
        for level in self.levels:
            index = cubemap.cells(level.resolution, torch.device(device))
            tables.append(torch.where(index < 0, index, index + level.offset))
        starts = torch.tensor([0, *(len(table) for table in tables[:-1])]).cumsum(0)
        resolutions = torch.tensor([level.resolution for level in self.levels])
        self._shapes = torch.stack([resolutions, starts]).to(device)
        self._table = torch.cat(tables)

    def apply(self, env: Tensor) -> Tensor:
        """Return the stacked levels and blocks (T, 3) of the cubemap env (6, R, R, 3); differentiable in env."""
        self.check(env)
        return _Apply.apply(env, self)

    def adjoint(self, levels: Tensor) -> Tensor:
        """Return the transpose of `apply`, (6, R, R, 3), on levels (T, 3); no gradient of its own."""
        return self.expand(levels, self.lobes, self.first_block)

    @functools.cached_property
    def dense_levels(self) -> Tensor:
        """The levels as a matrix (first_block, 6 R^2) of the light; for small lights: 94 MB at R = 16."""
        levels = (self.lobes.matrix() @ self.nodes.matrix()).toarray()
        return torch.from_numpy(levels).to(self.lobes.forward.value)

    def averages(self, env: Tensor, lobes: SparseOperator | ChosenRows) -> Tensor:
        """Return what `lobes`, all or some, see of env (6, R, R, 3), and below it the blocks."""
        texels = env.reshape(-1, 3)
        return torch.cat([lobes.apply(self.nodes.apply(texels)), self.blocks.apply(texels)])

    def expand(self, levels: Tensor, lobes: SparseOperator | ChosenRows, first_block: int) -> Tensor:
        """Return the transpose of `averages`, (6, R, R, 3), on `levels` whose blocks start at `first_block`."""
        gradient = self.nodes.adjoint(lobes.adjoint(levels[:first_block]))
        gradient += self.blocks.adjoint(levels[first_block:])
        return gradient.reshape(6, self.resolution, self.resolution, 3)

    def specular_taps(
        self, direction: Tensor, roughness: Tensor, scale: Tensor | float = 1.0
    ) -> tuple[Tensor, Tensor]:
        """Return index (N, 8) int32 into the levels and weight (N, 8) for lobes around `direction`.

        direction (N, 3), roughness (N,): bilinear within two levels, linear in 1 / alpha between them.
        Weights sum to `scale`, one or (N,), and are differentiable in all arguments; roughness is clamped to
        [0.08, 1.4].
        """
        level, fraction = self._level(roughness)
        coordinates = cubemap.face_coordinates(direction)
        above, taps = fraction * scale, []
        for k, part in ((level, scale - above), (level + 1, above)):
            resolution, start = self._shapes.index_select(1, k)
            taps.append(cubemap.cell_taps(coordinates, resolution, start, self._table, part))
        index, weight = zip(*taps, strict=True)
        return torch.cat(index, dim=-1), torch.cat(weight, dim=-1)

    def diffuse_taps(self, normal: Tensor) -> tuple[Tensor, Tensor]:
        """Return index (N, 4) int32 and weight (N, 4) that look up irradiance / pi around normals (N, 3)."""
        level = self._cosine
        index, weight = cubemap.bilinear_taps(normal, level.resolution)
        return index + level.offset, weight

    def _level(self, roughness: Tensor) -> tuple[Tensor, Tensor]:
        """Return the level below each roughness (int64) and the fraction (differentiable) towards the next."""
        known = self._sharpness.to(roughness.dtype)
        sharpness = roughness.clamp(MIN_ROUGHNESS, MAX_ROUGHNESS) ** -2
        level = (torch.searchsorted(-known, -sharpness.detach(), right=True) - 1).clamp(0, len(known) - 2)
        below = known.index_select(0, level)
        return level, (sharpness - below) / (known.index_select(0, level + 1) - below)

    def check(self, env: Tensor) -> None:
        """Raise `ConfigError` unless env is (6, R, R, 3) of this resolution."""
        size = self.resolution
        if env.shape != (6, size, size, 3):
            shape = tuple(env.shape)
            raise ConfigError(f"This prefilter takes cubemaps (6, {size}, {size}, 3), not {shape}.")


class PrefilterPart:
    """On a CPU, the rows of a prefilter's levels that one photo looks up, and the blocks."""

    def __init__(self, prefilter: Prefilter, rows: Tensor):
        """Restrict the levels to `rows` (K,), indices into the stack of levels."""
        self.prefilter, self.first_block = prefilter, len(rows)
        self._lobes = ChosenRows.of(prefilter.lobes, rows)

    def apply(self, env: Tensor) -> Tensor:
        """Return the chosen levels and below them the blocks (K + 384, 3) of env (6, R, R, 3); no gradient."""
        self.prefilter.check(env)
        return self.prefilter.averages(env.detach(), self._lobes)

    def adjoint(self, levels: Tensor) -> Tensor:
        """Return the transpose of `apply`, (6, R, R, 3), on (K + 384, 3)."""
        return self.prefilter.expand(levels, self._lobes, self.first_block)


@functools.lru_cache(maxsize=8)
def cached(
    resolution: int, device: torch.device | str = "cpu", accuracy: Accuracy | None = None
) -> Prefilter:
    """Return the process's shared prefilter of a resolution, device and accuracy; R = 128 takes seconds."""
    return Prefilter(resolution, device, accuracy)
